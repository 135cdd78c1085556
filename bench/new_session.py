"""Do intervals hold in a session of its own? Joints homed anew, frames moved before each, sessions told and not told.

    python bench/new_session.py [--seeds 5]

Of simulated RAVEN-II zig-zags joint 2 has another zero in each session, of simulated dVRK reaches the tracker's frame
lies elsewhere; the last session is held out. The peer is the same fit of the same log as one session.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from support import print_table, save_results

from gpcorrect.calibration import CommandCorrector, FitSettings, JointCorrector, fit_model
from gpcorrect.sim import random_reaches_log
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal
from gpcorrect_studies.peng2024 import RavenStudy

MOTIONS = 6  # of a session
HOMED, MOVED = 0.03, 0.004  # rad, m: deviation of a session's zero, and of its frame along each axis


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5, help="recordings of each kind")
    seeds = parser.parse_args().seeds
    rows: list[list[object]] = []
    for name, case in {"joints": joints, "poses": poses}.items():
        for sessions in (2, 3, 5):
            for apart in (True, False):
                for told in (True, False):
                    found = [case(sessions, apart, told, seed) for seed in range(seeds)]
                    held, wide = (np.mean(part, axis=0) for part in zip(*found, strict=True))
                    kind = f"{name}, {sessions} sessions {'apart' if apart else 'alike'}"
                    shares = [f"{100 * share:.0f}" for share in (held.min(), held.max())]
                    rows.append([kind, "told" if told else "as one", *shares, f"{wide:.3g}"])
    head = [
        "held out: one more session",
        "fit",
        "least % in 95 % intervals",
        "most",
        "half width of what is apart, deg, mm",
    ]
    print_table(head, rows)
    save_results("new_session", rows)


def joints(sessions: int, apart: bool, told: bool, seed: int) -> tuple[FloatArray, float]:
    """Share of errors in their intervals, joint by joint, and the mean half width of joint 2, deg."""
    log = in_sessions(RavenStudy(seed).zigzags("J1-J2-J3", sessions + 1), sessions + 1)
    zero = np.random.default_rng(seed).normal(0.0, HOMED * apart, sessions + 1)
    assert log.external_jp is not None
    log = replace(log, external_jp=log.external_jp + zero[log.session][:, None] * [0.0, 1.0, 0.0])
    part, new = split(log, sessions, told)
    answer = fit_model(part, FitSettings(), task=JointCorrector).corrector.correct_log(new)
    held = (np.abs(answer.joints - new.external_jp) <= answer.interval95).mean(axis=0)
    return held, float(np.degrees(answer.interval95[:, 1].mean()))


def poses(sessions: int, apart: bool, told: bool, seed: int) -> tuple[FloatArray, float]:
    """Share of errors in their intervals, axis by axis of the position, and their mean half width, mm."""
    log = in_sessions(random_reaches_log("dvrk_psm", (sessions + 1) * MOTIONS, seed), sessions + 1)
    place = np.random.default_rng(seed).normal(0.0, MOVED * apart, (sessions + 1, 3))
    assert log.tracker_cp is not None
    seen = PoseSignal(log.tracker_cp.position + place[log.session], log.tracker_cp.quaternion)
    log = replace(log, tracker_cp=seen)
    part, new = split(log, sessions, told)
    model = fit_model(part, FitSettings(), task=CommandCorrector).corrector
    found = model.measure(new, model.clean_afresh(new).keep)
    return found.coverage95[:3], 1e3 * float(found.interval95[:, :3].mean())


def in_sessions(log: CalibrationLog, sessions: int) -> CalibrationLog:
    """Return a log in sessions of as many motions each, in the order of recording."""
    names, order = np.unique(log.trajectory, return_inverse=True)
    order = order if len(names) > 1 else np.arange(len(log))  # a zig-zag is one trajectory
    motion = order * sessions * MOTIONS // (order.max() + 1)
    return replace(log, trajectory=motion, session=motion // MOTIONS)


def split(log: CalibrationLog, sessions: int, told: bool) -> tuple[CalibrationLog, CalibrationLog]:
    """Return all sessions but the last, told apart or as one, and the last."""
    known = log.session < sessions
    part = log.select(known)
    return part if told else replace(part, session=np.zeros(len(part), dtype=np.int64)), log.select(~known)


if __name__ == "__main__":
    main()
