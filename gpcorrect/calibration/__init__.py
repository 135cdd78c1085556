"""Calibration: one recipe for poses, joints and tool positions.

A task defines what it compares; learners, splits, cleaning, regions, bounds, intervals, streams and files are shared.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gpcorrect.calibration.cartesian import CommandCorrector
    from gpcorrect.calibration.drift import Ageing, Detection, detect, estimate_ageing
    from gpcorrect.calibration.evaluate import (
        COMPONENTS,
        METHODS,
        Evaluation,
        Experiment,
        evaluate_model,
        position_reductions,
        run_experiment,
    )
    from gpcorrect.calibration.excitation import amplitude_ladder, holds, random_sinusoids, random_sweeps, speed_ladder
    from gpcorrect.calibration.explore import Proposal, propose
    from gpcorrect.calibration.fit import FitResult, fit_corrector, fit_model
    from gpcorrect.calibration.history import HeldOut, PartErrors, Step, last_measured
    from gpcorrect.calibration.joint_view import InputSignal
    from gpcorrect.calibration.joints import JointCorrector, require_joints
    from gpcorrect.calibration.learners import LEARNERS, learner_named
    from gpcorrect.calibration.metrics import ErrorTable, JointErrors, error_table, joint_errors, joint_units, spread
    from gpcorrect.calibration.model_file import TASKS, load, load_any, model_hash, read_history, save
    from gpcorrect.calibration.model_store import Entry, ModelStore, compare, kind_of
    from gpcorrect.calibration.pose_samples import require_poses
    from gpcorrect.calibration.settings import FitSettings
    from gpcorrect.calibration.split import HoldOut, folds_of, held_out
    from gpcorrect.calibration.stream import JointStream, PoseStream, RobotState, ToolStream
    from gpcorrect.calibration.task import Corrector, Measured
    from gpcorrect.calibration.tool_position import PositionEstimator
    from gpcorrect.calibration.update import Update, update_model
    from gpcorrect.calibration.uses import PURPOSES, Use, for_purpose, with_uses
    from gpcorrect.calibration.zigzags import DIRECTIONS, Direction, TimedPath, direction_named, timed, zigzag

_HOMES = {
    "cartesian": ("CommandCorrector",),
    "drift": ("Ageing", "Detection", "detect", "estimate_ageing"),
    "evaluate": (
        "COMPONENTS",
        "METHODS",
        "Evaluation",
        "Experiment",
        "evaluate_model",
        "position_reductions",
        "run_experiment",
    ),
    "excitation": ("amplitude_ladder", "holds", "random_sinusoids", "random_sweeps", "speed_ladder"),
    "explore": ("Proposal", "propose"),
    "fit": ("FitResult", "fit_corrector", "fit_model"),
    "history": ("HeldOut", "PartErrors", "Step", "last_measured"),
    "joint_view": ("InputSignal",),
    "joints": ("JointCorrector", "require_joints"),
    "learners": ("LEARNERS", "learner_named"),
    "metrics": ("ErrorTable", "JointErrors", "error_table", "joint_errors", "joint_units", "spread"),
    "model_file": ("TASKS", "load", "load_any", "model_hash", "read_history", "save"),
    "model_store": ("Entry", "ModelStore", "compare", "kind_of"),
    "pose_samples": ("require_poses",),
    "settings": ("FitSettings",),
    "split": ("HoldOut", "folds_of", "held_out"),
    "stream": ("JointStream", "PoseStream", "RobotState", "ToolStream"),
    "task": ("Corrector", "Measured"),
    "tool_position": ("PositionEstimator",),
    "update": ("Update", "update_model"),
    "uses": ("PURPOSES", "Use", "for_purpose", "with_uses"),
    "zigzags": ("DIRECTIONS", "Direction", "TimedPath", "direction_named", "timed", "zigzag"),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "COMPONENTS",
    "DIRECTIONS",
    "LEARNERS",
    "METHODS",
    "PURPOSES",
    "TASKS",
    "Ageing",
    "CommandCorrector",
    "Corrector",
    "Detection",
    "Direction",
    "Entry",
    "ErrorTable",
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
    "Step",
    "TimedPath",
    "ToolStream",
    "Update",
    "Use",
    "amplitude_ladder",
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
    "held_out",
    "holds",
    "joint_errors",
    "joint_units",
    "kind_of",
    "last_measured",
    "learner_named",
    "load",
    "load_any",
    "model_hash",
    "position_reductions",
    "propose",
    "random_sinusoids",
    "random_sweeps",
    "read_history",
    "require_joints",
    "require_poses",
    "run_experiment",
    "save",
    "speed_ladder",
    "spread",
    "timed",
    "update_model",
    "with_uses",
    "zigzag",
]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
