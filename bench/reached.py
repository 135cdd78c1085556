"""Which pose does a command reach? Errors of the forward answer on held-out motion, beside the registration alone.

    python bench/reached.py [--trajectories 80]

The last fifth of the trajectories of a simulated dVRK and of the real one; of these the samples that cleaning passes.
The peer is the inverse of the registration: what a lab has without a model. Beside them the errors of the usual answer,
the command that a pose needs, of the same law.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np
from support import print_table, real_data, save_results

from gpcorrect.calibration import FitSettings, fit_corrector, reached
from gpcorrect.calibration.dataset import held_out
from gpcorrect.calibration.poses import rotations_of
from gpcorrect.logs import read_log
from gpcorrect.rigid import pose_residual
from gpcorrect.sim import random_reaches_log
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal
from gpcorrect.velocity import twists

SHARE = 0.2


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trajectories", type=int, default=80, help="of the simulated recording")
    rows = [row for name, log in recordings(parser.parse_args().trajectories) for row in rows_of(name, log)]
    print_table(["held-out errors", "mm RMS", "deg RMS", "95 % intervals hold [%]"], rows)
    save_results("reached", rows)


def recordings(trajectories: int) -> Iterator[tuple[str, CalibrationLog]]:
    yield "simulated dVRK", random_reaches_log("dvrk_psm", trajectories, 0)
    yield "real dVRK", read_log(real_data("dvrk_random.csv"))


def rows_of(name: str, log: CalibrationLog) -> list[list[object]]:
    """Learn from the first trajectories of a recording, and ask about the others both ways round."""
    held = held_out(log, SHARE)
    model = fit_corrector(log.select(~held), FitSettings(features=("pose", "velocity")))
    usual = model.measure(log, held & model.clean(log).keep)
    rows, sent, seen = usual.rows, log.setpoint_cp, log.tracker_cp
    velocity = twists(log.time, sent.position, rotations_of(sent), log.trajectory)[rows]
    moving = np.isfinite(velocity).all(axis=1)
    sent, seen, velocity = sent[rows][moving], seen[rows][moving], velocity[moving]
    answer = reached(model, np.hstack([sent.position, sent.quaternion]), velocity)
    forward = pose_residual(PoseSignal(answer.position, answer.quaternion), seen)
    cover = 100 * float((np.abs(forward) <= answer.interval95).mean())
    registered = pose_residual(model.rigid.inverse(sent), seen)
    return [
        [f"{name}: registration's inverse", *rms(registered), ""],
        [f"{name}: pose that a command reaches", *rms(forward), f"{cover:.1f}"],
        [f"{name}: command for a pose", *rms(usual.corrected[moving]), f"{100 * float(usual.coverage95.mean()):.1f}"],
    ]


def rms(errors: FloatArray) -> tuple[float, float]:
    squares = errors**2
    return 1e3 * float(np.sqrt(squares[:, :3].sum(axis=1).mean())), float(
        np.rad2deg(np.sqrt(squares[:, 3:].sum(axis=1).mean()))
    )


if __name__ == "__main__":
    main()
