"""What memory brings on a real dVRK: held-out last 20 %, pose + velocity beside memory of the pose and of the joints.

Two tables. "Cartesian": with the slacks on the pose, and corrected in the arm's joints. "Joint": a regression from
joints and joint velocities to the joints that must be commanded, with the play states of the joints' own path.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from support import print_table, real_data, save_results

from gpcorrect.calibration import FitSettings, run_experiment
from gpcorrect.calibration.memory import LADDER, SMALLEST
from gpcorrect.gpr import SparseGPR
from gpcorrect.logs import read_log
from gpcorrect.play import play_states
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray
from gpcorrect.velocity import derivative, segment_labels

HOLDOUT = 0.2
SEEDS = range(2)


def main() -> None:
    log = read_log(real_data("dvrk_random.csv"))
    cartesian = cartesian_rows(log)
    head = ["Cartesian, held out", "mm rmse", "deg rmse", "95 % covers"]
    print_table(head, cartesian)
    joint = joint_rows(log)
    joint_head = ["joint, held-out rmse", "J1 deg", "J2 deg", "J3 mm", "J4 deg", "J5 deg", "J6 deg"]
    print()
    print_table(joint_head, joint)
    save_results("memory_features", {"cartesian": [head, *cartesian], "joint": [joint_head, *joint]})


def cartesian_rows(log: CalibrationLog) -> list[list[Any]]:
    rows: list[list[Any]] = []
    for features in (
        ("pose",), ("pose", "velocity"), ("pose", "velocity", "memory"), ("pose", "velocity", "joints"),
    ):  # fmt: skip
        found = [scores(log, FitSettings(features=features, seed=seed)) for seed in SEEDS]
        rows.append([" + ".join(features), *np.mean(found, axis=0)])
    return rows


def scores(log: CalibrationLog, settings: FitSettings) -> list[float]:
    experiment = run_experiment(log, settings, holdout=HOLDOUT)
    clean = experiment.evaluation.clean
    errors = experiment.evaluation.clean_errors["corrected"]
    position, rotation = errors["position_mm"]["norm"]["rmse"], errors["rotation_deg"]["norm"]["rmse"]
    return [position, rotation, 100 * float(np.mean(clean.coverage95))]


def joint_rows(log: CalibrationLog) -> list[list[Any]]:
    """Rows of the joint regression: observed joints in, what must be added to command them out."""
    seen, asked = log.external_jp, log.setpoint_jp
    labels = segment_labels(log.time, log.trajectory)
    velocity = derivative(log.time, seen, labels)
    rows = np.isfinite(velocity).all(axis=1)
    ids = log.trajectory_ids
    held = np.isin(log.trajectory, ids[-round(HOLDOUT * len(ids)) :])
    train, test = rows & ~held, rows & held
    base = np.hstack([scaled(seen, train), scaled(velocity, train)])
    n = seen.shape[1]
    groups = (tuple(range(n)), tuple(range(n, 2 * n)))
    table: list[list[Any]] = [["raw", *units(rmse((asked - seen)[test]))]]
    for name, X, columns in (
        ("joints", base[:, :n], groups[:1]),
        ("joints + velocity", base, groups),
        *(
            (f"joints + velocity + memory, {smallest:g} of the range", np.hstack([base, M]), (*groups, wide(base, M)))
            for smallest, M in ((s, memory(seen, labels, train, s)) for s in SMALLEST)
        ),
    ):
        table.append([name, *units(joint_error(X, asked - seen, columns, log, train, test))])
    return table


def joint_error(
    X: FloatArray, Y: FloatArray, groups: Any, log: CalibrationLog, train: BoolArray, test: BoolArray
) -> FloatArray:
    model = SparseGPR(feature_groups=groups, output_groups=(3, 3))
    model.fit(X[train], Y[train], groups=log.trajectory[train], times=log.time[train])
    return rmse(Y[test] - model.predict(X[test]))


def memory(joints: FloatArray, labels: Any, train: BoolArray, smallest: float) -> FloatArray:
    half = np.ptp(np.percentile(joints[train], (2.5, 97.5), axis=0), axis=0) / 2
    radii = smallest * np.outer(LADDER, half)
    steps = np.diff(joints, axis=0, prepend=joints[:1])
    states = play_states(steps, radii, labels) / radii
    return states.reshape(len(joints), -1)


def wide(base: FloatArray, M: FloatArray) -> tuple[int, ...]:
    return tuple(range(base.shape[1], base.shape[1] + M.shape[1]))


def scaled(values: FloatArray, train: BoolArray) -> FloatArray:
    return (values - values[train].mean(axis=0)) / values[train].std(axis=0)


def rmse(errors: FloatArray) -> FloatArray:
    return np.sqrt((errors**2).mean(axis=0))


def units(values: FloatArray) -> FloatArray:
    """Degrees, and millimetres for the insertion."""
    return values * np.where(np.arange(len(values)) == 2, 1e3, np.rad2deg(1.0))


if __name__ == "__main__":
    main()
