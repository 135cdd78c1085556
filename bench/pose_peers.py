"""Correctors of poses beside what a lab would write itself, on machines whose logs hold poses alone.

    python bench/pose_peers.py [--sets gantry,tendons,platform --splits last,first,middle,every --ours gp,auto]

The machines are those of bench/pose_machines.py; `dvrk_random` is the real wrist, and with `dvrk_random alone` its
joints are hidden from us. Peers learn from the samples that pass our cleaning, registered as ours are. They see the
registered pose, its twist (five-point differences) and slacks of four widths of the six coordinates of the commands;
each is scikit-learn's with its defaults but for scaled inputs. `every` holds out every fifth trajectory. With `--loop`
desired paths that no training has seen are sent through models and machines, and the place arrived at is measured.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import numpy as np
from pose_machines import MACHINES, arrived, desired, machine_log
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.linear_model import Ridge
from sklearn.multioutput import MultiOutputRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from support import print_table, real_data, save_results

from gpcorrect import se3
from gpcorrect.calibration import CommandCorrector, FitSettings, fit_model
from gpcorrect.calibration.memory import MemoryMap, steps
from gpcorrect.calibration.poses import Steps, rotations_of
from gpcorrect.logs import read_log
from gpcorrect.rigid import pose_residual
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray
from gpcorrect.velocity import segment_labels, twists

REAL = "dvrk_random.csv"
WIDTHS = (0.0125, 0.05, 0.2, 0.5)  # of the slacks, over the spread of a coordinate
PAUSE = 10.0  # s
TEST_SEED, TEST_MOTIONS = 99, 9
HELD = ("95 % x", "95 % y", "95 % z", "95 % rx", "95 % ry", "95 % rz")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", default=",".join(MACHINES))
    parser.add_argument("--splits", default="last,first,middle,every")
    parser.add_argument("--ours", default="gp,auto")
    parser.add_argument("--seed", type=int, default=0, help="of the machines' motions and faults")
    parser.add_argument("--loop", action="store_true", help="send new paths through models and machines instead")
    parser.add_argument("--same-velocities", action="store_true", help="peers see twists through our stencils")
    args = parser.parse_args()
    results = {}
    for name in args.sets.split(","):
        if args.loop:
            print_table([f"{name}, in closed loop", "mm rmse", "deg rmse"], closed_loop(name))
            continue
        log = machine_log(name, args.seed) if name in MACHINES else read_log(real_data(REAL))
        if name.endswith("alone"):
            log = replace(log, **dict.fromkeys(log.JOINTS))
        for split in args.splits.split(","):
            rows = compare(log, held_out(log, split), args.ours.split(","), same=args.same_velocities)
            print_table([f"{name}, {split}", "mm rmse", "deg rmse", *HELD], rows)
            print(flush=True)
            results[f"{name} {split}"] = rows
    if not args.loop:
        save_results("pose_peers", results)


def held_out(log: CalibrationLog, split: str) -> BoolArray:
    """Return which samples are measured on."""
    ids = np.asarray(log.trajectory_ids)
    fifth = max(1, len(ids) // 5)
    first = {"first": 0, "middle": 2 * fifth, "last": len(ids) - fifth}
    chosen = ids[2::5] if split == "every" else ids[first[split] : first[split] + fifth]
    return np.isin(log.trajectory, chosen)


def compare(log: CalibrationLog, test: BoolArray, ours: list[str], *, same: bool) -> list[list[Any]]:
    """Return errors at held-out samples of every way to correct, and what of them each axis' intervals hold."""
    known, asked = log.select(~test), log.select(test)
    models = {name: fit_model(known, FitSettings(method=name)).corrector for name in ours}
    first: CommandCorrector = next(iter(models.values()))
    measured = {name: model.measure(asked, model.clean(asked).keep) for name, model in models.items()}
    sample = next(iter(measured.values()))
    X, Y, _ = inputs(first, known, first.velocity_steps if same else (0.0, 0.0))
    Z, target, rows = inputs(first, asked, first.velocity_steps if same else (0.0, 0.0))
    both, at = np.isin(sample.rows, rows), np.isin(rows, sample.rows)
    Z, target, spread = Z[at], target[at], Y.std(axis=0)
    table = [row("raw", sample.raw[both]), row("registration", sample.registered[both])]
    peers = {
        "linear": (Ridge(1e-6), 12),
        "ridge + slacks": (Ridge(), None),
        "boosted trees + slacks": (MultiOutputRegressor(HistGradientBoostingRegressor()), None),
    }
    for name, (peer, width) in peers.items():
        model = make_pipeline(StandardScaler(), peer).fit(X[:, :width], Y / spread)
        table.append(row(name, target - model.predict(Z[:, :width]) * spread))
    for name, found in measured.items():
        covered = np.abs(found.corrected[both]) <= found.interval95[both]
        table.append(row(f"ours, {name}", found.corrected[both], covered))
    return table


def closed_loop(name: str) -> list[list[Any]]:
    """Return how far from new desired paths a machine arrives: sent as desired, and as models say."""
    recalling = fit_model(machine_log(name), FitSettings(features=("pose", "velocity", "memory"))).corrector
    time, counted, told, wanted = desired(name, TEST_SEED, TEST_MOTIONS)
    commands = {"as desired": told}
    for way, model in {"pose and velocity": replace(recalling, memory=None), "and memory": recalling}.items():
        answer = model.correct_path(np.hstack([wanted.position, wanted.quaternion]), time)
        commands[way] = answer.poses
    return [row(way, pose_residual(arrived(name, sent), wanted)[counted])[:3] for way, sent in commands.items()]


def inputs(model: CommandCorrector, log: CalibrationLog, stencils: Steps) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return what peers see, what they are to find, and the rows of the log that are complete."""
    assert log.tracker_cp is not None
    assert log.setpoint_cp is not None
    keep = np.flatnonzero(model.clean(log).keep & log.tracker_cp.finite & log.setpoint_cp.finite)
    time, labels = log.time[keep], np.cumsum(np.diff(log.time[keep], prepend=log.time[0]) > PAUSE, dtype=np.int64)
    reference, command = model.rigid.apply(log.tracker_cp[keep]), log.setpoint_cp[keep]
    rotations = rotations_of(reference)
    assert rotations is not None
    runs = segment_labels(time, log.trajectory[keep])
    linear, angular = (twists(time, reference.position, rotations, runs, step or None) for step in stencils)
    twist = np.hstack([linear[:, :3], angular[:, 3:]])
    turned = se3.rotvec_from_matrix(rotations @ model.features.R_mean.T)
    path = np.cumsum(steps(command), axis=0)
    slacks = MemoryMap(np.outer(WIDTHS, path.std(axis=0))).transform(command, reference, labels)
    X, Y = np.hstack([reference.position, turned, twist, slacks]), pose_residual(reference, command)
    whole = np.isfinite(X).all(axis=1) & np.isfinite(Y).all(axis=1)
    return X[whole], Y[whole], keep[whole]


def row(name: str, errors: FloatArray, covered: BoolArray | None = None) -> list[Any]:
    """Return a row of the table."""
    mm, rad = (np.sqrt((errors[:, part] ** 2).sum(axis=1).mean()) for part in (slice(3), slice(3, 6)))
    held = ["-"] * 6 if covered is None else [f"{100 * share:.1f}" for share in covered.mean(axis=0)]
    return [name, 1e3 * float(mm), float(np.rad2deg(rad)), *held]


if __name__ == "__main__":
    main()
