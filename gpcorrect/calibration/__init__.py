"""Calibration: one recipe for poses, joints and tool positions.

A task defines what it compares; learners, splits, cleaning, regions, bounds, intervals, streams and files are shared.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gpcorrect.lazy import imported_on_demand

if TYPE_CHECKING:
    from gpcorrect.calibration.arm_kinematics import with_outside_joints, with_poses
    from gpcorrect.calibration.cartesian import CommandCorrector
    from gpcorrect.calibration.dataset import HoldOut, folds_of
    from gpcorrect.calibration.drift import Ageing, Detection, chance_of_larger, detect, estimate_ageing
    from gpcorrect.calibration.evaluate import (
        COMPONENTS,
        Evaluation,
        Experiment,
        evaluate_model,
        part_errors,
        position_reductions,
        run_experiment,
    )
    from gpcorrect.calibration.excitation import (
        DIRECTIONS,
        Direction,
        TimedPath,
        direction_named,
        random_sinusoids,
        random_sweeps,
        timed,
        zigzag,
    )
    from gpcorrect.calibration.explore import Proposal, propose
    from gpcorrect.calibration.fit import FitResult, fit_corrector, fit_model
    from gpcorrect.calibration.forward import reached, reached_path
    from gpcorrect.calibration.history import HeldOut, PartErrors, Step, command_line, last_measured, now, versions
    from gpcorrect.calibration.joints import JointCorrector
    from gpcorrect.calibration.learners import LEARNERS, learner_named
    from gpcorrect.calibration.metrics import JointErrors, error_table, joint_units, spread
    from gpcorrect.calibration.model_file import load, load_any, load_with_hash, model_hash, require_model_place, save
    from gpcorrect.calibration.model_store import Entry, ModelStore, refuse_other_use
    from gpcorrect.calibration.pose_answers import PoseStream
    from gpcorrect.calibration.settings import FitSettings, InputSignal
    from gpcorrect.calibration.side_by_side import (
        Difference,
        SideBySide,
        commands_apart,
        compare,
        measure_both,
        refuse_unlike,
    )
    from gpcorrect.calibration.stream import JointStream, RobotState, ToolStream
    from gpcorrect.calibration.task import Corrector, Measured
    from gpcorrect.calibration.tool_position import PositionEstimator
    from gpcorrect.calibration.update import Update, update_model
    from gpcorrect.calibration.uses import PURPOSES, Use, for_purpose, with_uses

__getattr__ = imported_on_demand(
    __name__,
    {
        "arm_kinematics": "with_outside_joints with_poses",
        "cartesian": "CommandCorrector",
        "dataset": "HoldOut folds_of",
        "drift": "Ageing Detection chance_of_larger detect estimate_ageing",
        "evaluate": "COMPONENTS Evaluation Experiment evaluate_model part_errors position_reductions run_experiment",
        "excitation": "DIRECTIONS Direction TimedPath direction_named random_sinusoids random_sweeps timed zigzag",
        "explore": "Proposal propose",
        "fit": "FitResult fit_corrector fit_model",
        "forward": "reached reached_path",
        "history": "HeldOut PartErrors Step command_line last_measured now versions",
        "joints": "JointCorrector",
        "learners": "LEARNERS learner_named",
        "metrics": "JointErrors error_table joint_units spread",
        "model_file": "load load_any load_with_hash model_hash require_model_place save",
        "model_store": "Entry ModelStore refuse_other_use",
        "pose_answers": "PoseStream",
        "settings": "FitSettings InputSignal",
        "side_by_side": "Difference SideBySide commands_apart compare measure_both refuse_unlike",
        "stream": "JointStream RobotState ToolStream",
        "task": "Corrector Measured",
        "tool_position": "PositionEstimator",
        "update": "Update update_model",
        "uses": "PURPOSES Use for_purpose with_uses",
    },
)

__all__ = [
    "COMPONENTS",
    "DIRECTIONS",
    "LEARNERS",
    "PURPOSES",
    "Ageing",
    "CommandCorrector",
    "Corrector",
    "Detection",
    "Difference",
    "Direction",
    "Entry",
    "Evaluation",
    "Experiment",
    "FitResult",
    "FitSettings",
    "HeldOut",
    "HoldOut",
    "InputSignal",
    "JointCorrector",
    "JointErrors",
    "JointStream",
    "Measured",
    "ModelStore",
    "PartErrors",
    "PoseStream",
    "PositionEstimator",
    "Proposal",
    "RobotState",
    "SideBySide",
    "Step",
    "TimedPath",
    "ToolStream",
    "Update",
    "Use",
    "chance_of_larger",
    "command_line",
    "commands_apart",
    "compare",
    "detect",
    "direction_named",
    "error_table",
    "estimate_ageing",
    "evaluate_model",
    "fit_corrector",
    "fit_model",
    "folds_of",
    "for_purpose",
    "joint_units",
    "last_measured",
    "learner_named",
    "load",
    "load_any",
    "load_with_hash",
    "measure_both",
    "model_hash",
    "now",
    "part_errors",
    "position_reductions",
    "propose",
    "random_sinusoids",
    "random_sweeps",
    "reached",
    "reached_path",
    "refuse_other_use",
    "refuse_unlike",
    "require_model_place",
    "run_experiment",
    "save",
    "spread",
    "timed",
    "update_model",
    "versions",
    "with_outside_joints",
    "with_poses",
    "with_uses",
    "zigzag",
]
