"""Which pose does a command reach? Errors of the forward answer on held-out motion, beside the registration alone.

    python bench/reached.py [--trajectories 80]

The last fifth of the trajectories of a simulated dVRK and of the real one; of these the samples that cleaning passes.
The first peer is the inverse of the registration: what a lab has without a model. The second is boosted trees from
commanded joints, their velocities and slacks to what the registration leaves. Beside them the errors of the usual
answer, the command that a pose needs, of the same law.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np
from scipy.signal import lfilter
from sklearn.ensemble import HistGradientBoostingRegressor
from support import print_table, real_data, save_results

from gpcorrect.calibration import FitSettings, fit_corrector, forward, reached, reached_path
from gpcorrect.calibration.dataset import held_out
from gpcorrect.calibration.poses import rotations_of
from gpcorrect.logs import read_log
from gpcorrect.play import play_states
from gpcorrect.rigid import apply_residual, pose_residual
from gpcorrect.sim import debridement_log, random_reaches_log
from gpcorrect.types import CalibrationLog, FloatArray, IntArray, PoseSignal
from gpcorrect.velocity import twists

SHARE, WIDTHS = 0.2, (0.02, 0.1, 0.3)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trajectories", type=int, default=80, help="of the simulated recording")
    rows = [row for name, log in recordings(parser.parse_args().trajectories) for row in rows_of(name, log)]
    print_table(["held-out errors", "mm RMS", "deg RMS", "95 % intervals hold [%]"], rows)
    save_results("reached", rows)
    late = [row for name, log in late_recordings() for row in late_rows_of(name, log)]
    print_table(["without joints", "mm RMS", "95 % intervals hold [%]", "in the domain [%]"], late)
    save_results("reached_late", late)


def recordings(trajectories: int) -> Iterator[tuple[str, CalibrationLog]]:
    yield "simulated dVRK", random_reaches_log("dvrk_psm", trajectories, 0)
    yield "real dVRK", read_log(real_data("dvrk_random.csv"))


def late_recordings() -> Iterator[tuple[str, CalibrationLog]]:
    yield "servo of 60 ms", behind_a_servo(0.06)
    yield "servo of 120 ms", behind_a_servo(0.12)
    yield "simulated debridement", debridement_log()
    yield "real dVRK", read_log(real_data("dvrk_random.csv"))


def behind_a_servo(lag: float, step: float = 0.02) -> CalibrationLog:
    """Return 24 motions of a point that follows fast sines late, s, seen to 0.1 mm."""
    rng, time = np.random.default_rng(0), np.arange(60) * step
    swings = 0.08 * np.sin(rng.uniform(2.5, 5.0, (24, 1, 3)) * time[:, None] + rng.uniform(0, 2 * np.pi, (24, 1, 3)))
    share, start = 1 - np.exp(-step / lag), swings[:, :1]
    seen = lfilter([share], [1, share - 1], swings - start, axis=1) + start
    return CalibrationLog(
        time=np.add.outer(10.0 * np.arange(24), time).ravel(),
        trajectory=np.repeat(np.arange(24), 60),
        session=np.zeros(24 * 60),
        setpoint_cp=PoseSignal(swings.reshape(-1, 3)),
        tracker_cp=PoseSignal(seen.reshape(-1, 3) + 1e-4 * rng.standard_normal((24 * 60, 3))),
    )


def late_rows_of(name: str, log: CalibrationLog) -> list[list[object]]:
    """Ask for the paths of the last trajectories with 0, 1 and all half steps of the velocities."""
    held, every, found = held_out(log, SHARE), forward.FOLLOW_STEPS, []
    model = fit_corrector(log.select(~held), FitSettings(features=("pose", "velocity")))
    rows = np.flatnonzero(held & model.clean(log).keep & np.isfinite(log.tracker_cp.position).all(axis=1))
    for steps in (0, 1, every):
        forward.FOLLOW_STEPS = steps
        path = reached_path(model, log.setpoint_cp.table[held], log.time[held])
        answer = path[np.searchsorted(np.flatnonzero(held), rows)]
        left = pose_residual(answer.poses, log.tracker_cp[rows])[:, :3]
        known = answer.in_domain
        cover = 100 * (np.abs(left) <= answer.interval95[:, :3])[known].mean(axis=0)
        size = 1e3 * np.sqrt(np.mean(np.sum(left[known] ** 2, axis=1)))
        held_by = f"{cover.mean():.1f} ({cover.min():.0f} to {cover.max():.0f})"
        found.append([f"{name}: {steps} half steps", f"{size:.3f}", held_by, f"{100 * known.mean():.1f}"])
    return found


def rows_of(name: str, log: CalibrationLog) -> list[list[object]]:
    """Learn from the first trajectories of a recording, and ask about the others both ways round."""
    held = held_out(log, SHARE)
    models = [fit_corrector(log.select(~held), FitSettings(features=f)) for f in (("pose", "velocity"), ())]
    usual = models[0].measure(log, held & models[0].clean(log).keep)
    velocity = twists(log.time, log.setpoint_cp.position, rotations_of(log.setpoint_cp), log.trajectory)
    rows = usual.rows[np.isfinite(velocity[usual.rows]).all(axis=1)]
    sent, seen, rigid = log.setpoint_cp.table, log.tracker_cp[rows], models[0].rigid
    registered = rigid.inverse(log.setpoint_cp)
    path = reached_path(models[1], sent[held], log.time[held])
    answers = {
        "each command for itself": reached(models[0], sent[rows], velocity[rows]),
        "a path of commands": path[np.searchsorted(np.flatnonzero(held), rows)],
    }
    found = [[f"{name}: registration's inverse", *rms(pose_residual(registered[rows], seen)), ""]]
    trees = boosted(log, registered, np.flatnonzero(~held), rows)
    found.append([f"{name}: and boosted trees", *rms(pose_residual(trees, seen)), ""])
    for way, answer in answers.items():
        left = pose_residual(answer.poses, seen)
        cover = 100 * (np.abs(left) <= answer.interval95).mean(axis=0)
        found.append([f"{name}: {way}", *rms(left), f"{cover.mean():.1f} ({cover.min():.0f} to {cover.max():.0f})"])
    covered = f"{100 * float(usual.coverage95.mean()):.1f}"
    return [*found, [f"{name}: command for a pose, by itself", *rms(usual.corrected), covered]]


def boosted(log: CalibrationLog, registered: PoseSignal, train: IntArray, test: IntArray) -> PoseSignal:
    """Return where boosted trees say that commands end: the registration's pose, moved by what they predict."""
    q = log.setpoint_jp
    half, new = np.ptp(q, axis=0) / 2, np.diff(log.trajectory, prepend=-1) != 0
    steps = np.where(new[:, None], 0.0, np.diff(q, axis=0, prepend=q[:1])) / half
    slacks = play_states(steps, np.outer(WIDTHS, np.ones(q.shape[1])), np.cumsum(new)).reshape(len(q), -1)
    X = np.hstack([q, steps, slacks])
    left = pose_residual(registered, log.tracker_cp)
    known = train[np.isfinite(left[train]).all(axis=1)]
    trees = [HistGradientBoostingRegressor(random_state=0).fit(X[known], column) for column in left[known].T]
    return apply_residual(registered[test], np.stack([tree.predict(X[test]) for tree in trees], axis=1))


def rms(errors: FloatArray) -> tuple[float, float]:
    squares = errors**2
    return 1e3 * float(np.sqrt(squares[:, :3].sum(axis=1).mean())), float(
        np.rad2deg(np.sqrt(squares[:, 3:].sum(axis=1).mean()))
    )


if __name__ == "__main__":
    main()
