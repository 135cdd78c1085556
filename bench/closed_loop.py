"""Where a simulated arm arrives when a planner's smooth path is sent through a model: the error that counts.

Errors of held-out commands compare what would be told with what was told. Here the told commands move the machine: a
path of reaches that no training has seen is asked for pose by pose, each answer is sent, and the marker's true path is
compared with the desired one. Four ways: commanded as desired after registration by the simulator's own frames, the
law of pose and velocity alone, that with memory of the commands, and the model as `gpcorrect fit` makes it.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import numpy as np
from support import print_table, save_results

from gpcorrect import se3
from gpcorrect.arms import arm_named
from gpcorrect.calibration import FitSettings, fit_model
from gpcorrect.rigid import pose_residual
from gpcorrect.sim import Machine, Plan, machine_of, preset, random_reaches_log, run
from gpcorrect.sim.reaches import rehomed
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

ARMS = ("dvrk_psm", "raven2_left")
SEARCH_SAMPLES = 600
TEST_SEED = 77


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--reaches", type=int, default=60, help="Of the training.")
    parser.add_argument("--paths", type=int, default=12, help="To follow.")
    arguments = parser.parse_args()
    head = ["arm", "commanded", "mm rmse", "deg rmse"]
    table: list[list[Any]] = []
    for arm in ARMS:
        table += rows_of(arm, arguments.reaches, arguments.paths)
    print_table(head, table)
    save_results("closed_loop", [head, *table])


def rows_of(name: str, reaches: int, paths: int) -> list[list[Any]]:
    log, settings = random_reaches_log(name, reaches, 0, faults=False), FitSettings(search_samples=SEARCH_SAMPLES)
    corrector = fit_model(log, settings).corrector
    recalling = fit_model(log, replace(settings, features=("pose", "velocity", "memory"))).corrector
    test = random_reaches_log(name, paths, TEST_SEED, faults=False)
    machine = machine_of(rehomed(preset(name), 1, np.random.default_rng([0, 2])))  # the training's homing
    models = {"pose and velocity": replace(recalling, memory=None), "memory": recalling, "as fitted": corrector}
    found: dict[str, list[FloatArray]] = {way: [] for way in ("as desired", *models)}
    for number in test.trajectory_ids:
        path = test.select(test.trajectory == number)
        wanted = seen(machine, matrices(path.setpoint_cp))
        asked = np.hstack([wanted.position, wanted.quaternion])
        told = {"as desired": path.setpoint_cp}
        for way, model in models.items():
            answer = model.correct_path(asked, path.time - path.time[0])
            told[way] = answer.poses
        for way, commands in told.items():
            found[way].append(pose_residual(seen(machine, arrived(name, machine, commands, path)), wanted))
    how = "in its joints" if corrector.route is not None else "without joints"
    return [[name, f"{way} ({how})" if way == "as fitted" else way, *sizes(np.vstack(e))] for way, e in found.items()]


def arrived(name: str, machine: Machine, commands: PoseSignal, path: CalibrationLog) -> FloatArray:
    """Return the tip's true poses (n, 4, 4) after commands."""
    q = arm_named(name).follow(matrices(commands), path.setpoint_jp[0])
    rate = 1.0 / float(np.median(np.diff(path.time)))
    first = np.zeros(1)
    plan = Plan(rate, q[:, None], np.zeros((len(q), 1), dtype=np.int64), first.astype(np.int64), first, first * np.nan)
    tip = run(machine, plan).T_base_tip
    return tip[:, 0]


def seen(machine: Machine, T: FloatArray) -> PoseSignal:
    """Return the marker's poses in the tracker's frame, without noise."""
    marker = se3.compose(machine.T_tracker_base, T, machine.T_tip_marker)
    return PoseSignal(marker[:, :3, 3], se3.quaternion_from_matrix(marker[:, :3, :3]))


def matrices(poses: PoseSignal) -> FloatArray:
    return se3.pose(se3.matrix_from_quaternion(poses.quaternion), poses.position)


def sizes(errors: FloatArray) -> list[float]:
    """Root mean squares of the lengths, mm and degrees."""
    position, rotation = (np.sqrt((part**2).sum(axis=1).mean()) for part in (errors[:, :3], errors[:, 3:]))
    return [1e3 * float(position), float(np.rad2deg(rotation))]


if __name__ == "__main__":
    main()
