"""Where the degrees of held-out poses are lost: on the real wrist, last, first and middle fifth of its trajectories.

    python bench/pose_budget.py [--splits last,first,middle]

The same samples, each row a step from what is recorded to what `gpcorrect fit` answers. "Commanded" rows are errors of
the command for a pose that was reached, as `fit` quotes them. "Reached" rows go the other way: the pose that a joint
model says a command reaches, beside the one that was reached. Many commands reach one pose where an arm sticks, so that
the first are larger than the second.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import numpy as np
from joint_peers import ids_of
from support import print_table, real_data, save_results

from gpcorrect import se3
from gpcorrect.calibration import CommandCorrector, FitSettings, fit_corrector
from gpcorrect.calibration.joint_route import JointRoute
from gpcorrect.logs import read_log
from gpcorrect.rigid import pose_residual
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--splits", default="last,first,middle")
    parser.add_argument("--method", default="gp")
    args = parser.parse_args()
    log = read_log(real_data("dvrk_random.csv"))
    head = ["held out", "mm rms", "deg rms", "deg mean", "deg median", "deg rms without the worst 1 %", "covered %"]
    results: dict[str, Any] = {}
    for split in args.splits.split(","):
        held = np.isin(log.trajectory, ids_of(log, split))
        model = fit_corrector(log.select(~held), FitSettings(method=args.method))
        results[split] = rows_of(model, log, held)
        print(f"\n{split} fifth held out: {'; '.join(model.summary['remarks'][-1:])}")
        print_table(head, results[split])
    save_results("pose_budget", {"head": head, **results})


def rows_of(model: CommandCorrector, log: CalibrationLog, held: BoolArray) -> list[list[Any]]:
    """Rows of one split; the samples are those that pass the cleaning."""
    passed = np.zeros(len(log), dtype=bool)
    passed[held] = model.clean(log.select(held)).keep
    measured = model.measure(log, passed)
    rows = [
        ["commanded: raw", *sizes(measured.raw), np.nan],
        ["commanded: registered", *sizes(measured.registered), np.nan],
    ]
    ways = {"pose and velocity": replace(model, route=None), "as fitted": model}
    if model.route is not None:
        ways["in the joints, without aim"] = replace(model, route=replace(model.route, aim=None))
    for name, way in ways.items():
        found = way.measure(log, passed)
        rows.append([f"commanded: {name}", *sizes(found.corrected), 100 * float(found.coverage95.mean())])
    if model.route is not None and model.route.aim is not None:
        rows += reached_rows(model.route, model, log, measured.rows)
    return rows


def reached_rows(route: JointRoute, model: CommandCorrector, log: CalibrationLog, rows: IntArray) -> list[list[Any]]:
    """Poses composed of the joints that recorded commands reach: with all their errors, and with one joint's less."""
    asked, wanted = (
        route.kinematics.inverse(log.setpoint_cp),
        route.kinematics.inverse(model.rigid.apply(log.tracker_cp)),
    )
    found = route.aim.reached.correct_path(asked, log.time, sessions=log.session.tolist()).joints
    table = [["reached: joints of the recorded commands", *composed(route, wanted, found, rows), np.nan]]
    for joint in range(found.shape[1]):
        without = found.copy()
        without[:, joint] = wanted[:, joint]
        table.append(
            [f"reached: without the error of joint {joint + 1}", *composed(route, wanted, without, rows), np.nan]
        )
    return table


def composed(route: JointRoute, wanted: FloatArray, found: FloatArray, rows: IntArray) -> list[float]:
    known = rows[np.isfinite(wanted[rows]).all(axis=1) & np.isfinite(found[rows]).all(axis=1)]
    chain = route.kinematics.chain
    poses = [
        PoseSignal(T[:, :3, 3], se3.quaternion_from_matrix(T[:, :3, :3]))
        for T in (chain.forward(wanted[known]), chain.forward(found[known]))
    ]
    return sizes(pose_residual(*poses))


def sizes(errors: FloatArray) -> list[float]:
    """Root mean square mm; of the degrees that, mean, median, and root mean square without the worst hundredth."""
    position, rotation = (np.linalg.norm(part, axis=1) for part in (1e3 * errors[:, :3], np.rad2deg(errors[:, 3:])))
    best = np.sort(rotation)[: int(0.99 * len(rotation))]
    return [rms(position), rms(rotation), float(rotation.mean()), float(np.median(rotation)), rms(best)]


def rms(values: FloatArray) -> float:
    return float(np.sqrt((values**2).mean()))


if __name__ == "__main__":
    main()
