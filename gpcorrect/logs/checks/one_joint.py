"""Checks of each joint by itself: a whole turn off, dead, late. Signals of all joints together hide one of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gpcorrect.logs.checks.evidence import MIN_PAIRED, Evidence, Finding, Severity, check
from gpcorrect.logs.checks.signals import MANY_MISSING, MOVED_JOINT, runs
from gpcorrect.logs.sync.motion import STILL, Motion, MotionPair, clock_runs
from gpcorrect.logs.sync.refine import Timing
from gpcorrect.types import CalibrationLog, FloatArray, IntArray

PAIRS = (("measured_jp", "setpoint_jp"), ("external_jp", "measured_jp"), ("external_jp", "setpoint_jp"))
DRIVEN = {"external_jp": ("measured_jp", "setpoint_jp"), "measured_jp": ("setpoint_jp",)}  # what moves a reading
TURN = 2 * np.pi  # rad
MOST_TURNS = 4  # more are another unit
NEAR_TURN = 0.5
"""rad about whole turns in which differences lie: the wrists of the real recordings miss by up to 0.3 rad, and degrees
taken for radians lie within by chance only, a sixth of them."""
NEARLY_ALL = 0.9  # of the samples, that must lie so near
LONE = 0.01  # of the samples, up to which turns are faults of single samples, which cleaning rejects
LATE = {"measured_jp": 0.03, "setpoint_jp": 0.05}
"""s by which a joint's delay differs from that of the others, above which it is late: drives with six plays and
viscoelastic cables differed by up to 8 ms, servos by a usual lag. A step of a slow log, if that is more."""
MOST = 20_000  # samples of a part that are looked at: two minutes of a fast controller
LEAST_SECONDS = 15.0
"""Of each half of a recording: simulated joints with slack, recorded for 18 s, were called 130 and 280 ms late."""
BRACKET = 0.5  # s about the common delay, in which that of a joint is looked for
FOLLOWS = 0.99
"""Share of a joint's spread that the motors explain, below which slack or noise hide its delay: in the real recordings
0.999 and more at joints that move by more than they miss, 0.97 to 0.99 at wrists, whose delays are off by 0.2 s."""
DEAD_TRAVEL = 0.25  # of what the motor covers, while its joint's reading stays to the last bit: no slack is so wide


@dataclass(frozen=True)
class Turned:
    """Where a joint's reading is whole turns off what another signal has: `turns` (n,), NaN where one is unknown."""

    turns: FloatArray
    other: str  # signal that it was compared with
    jumps: IntArray  # rows at which the turns change

    @property
    def lone(self) -> bool:
        """Whether so few samples are off that they are faults of their own."""
        known = self.turns[np.isfinite(self.turns)]
        return bool((known != np.median(known)).mean() < LONE) and float(np.median(known)) == 0.0


def turned_joints(evidence: Evidence) -> dict[tuple[str, int], Turned]:
    """Return which joints, by signal and index, read whole turns more or less than another signal of them.

    Parameters
    ----------
    evidence : Evidence
    """
    found: dict[tuple[str, int], Turned] = {}
    for name, other in evidence.both(PAIRS):
        for j, (a, b) in enumerate(zip(evidence.tables[name].T, evidence.tables[other].T, strict=False)):
            slides = evidence.joint_types[j : j + 1] == "P"
            turns = None if slides or (other, j) in found or (name, j) in found else _turns(a - b)
            if turns is not None:
                known = np.flatnonzero(np.isfinite(turns))
                found[name, j] = Turned(turns, other, known[1:][np.diff(turns[known]) != 0])
    return found


def _turns(gap: FloatArray) -> FloatArray | None:
    """Return by how many turns each difference `(n,)` is off; None where they are none, or no whole turns."""
    known = gap[np.isfinite(gap)]
    if len(known) < MIN_PAIRED:
        return None
    usual = known - TURN * np.round(known / TURN)
    offset = float(np.median(usual))  # within a turn: its zero, which is learned
    turns = np.round((gap - offset) / TURN)
    left = np.abs(known - offset - TURN * np.round((known - offset) / TURN))
    most = np.nanmax(np.abs(turns))
    return turns if 0 < most <= MOST_TURNS and (left < NEAR_TURN).mean() > NEARLY_ALL else None


@check
def _joint_turn(evidence: Evidence) -> Iterator[Finding]:
    """Ask whether a joint reads a whole turn more or less than what moves it, always or from some row on."""
    for (name, j), turned in turned_joints(evidence).items():
        count = int((turned.turns[np.isfinite(turned.turns)] != 0).sum())
        if turned.jumps.size:
            times = "once" if len(turned.jumps) == 1 else f"{len(turned.jumps)} times, first"
            what = f"joint {j + 1} jumps by a turn against {turned.other}, {times} at row {turned.jumps[0]}."
            hint = "Unwrap its column: add or take away 2 pi from there on, so that it runs on as the joint does."
        else:
            k = int(np.nanmedian(turned.turns))
            turns = "a whole turn" if abs(k) == 1 else f"{abs(k)} whole turns"
            what = f"joint {j + 1} reads {turns} {'more' if k > 0 else 'less'} than in {turned.other}."
            hint = f"Set offset = {-k * TURN:.6g} for its column in the mapping file."
        severity: Severity = "warning" if turned.lone else "error"
        yield Finding(severity, "joint_turn", name, what, hint, count, turned.jumps)


@check
def _joint_dead(evidence: Evidence) -> Iterator[Finding]:
    """Find joints whose reading stays to the last bit while what moves them does: for the whole log, or a part."""
    for name, references in DRIVEN.items():
        reference = next((r for r in references if {name, r} <= evidence.present), None)
        if reference is None:
            continue
        read, motors = evidence.tables[name], evidence.tables[reference]
        same = (read == read[evidence.previous]) & (evidence.previous >= 0)[:, None]
        for j in range(min(read.shape[1], motors.shape[1])):
            least = 0.1 * MOVED_JOINT if evidence.joint_types[j : j + 1] == "P" else MOVED_JOINT
            stuck = [
                (start, stop)
                for start, stop in runs(same[:, j]).tolist()
                if not same[start:stop].all() and _moved_on(motors[start - 1 : stop, j], motors[:, j], least)
            ]
            if stuck:
                yield _dead(name, reference, j, stuck, read[np.isfinite(read[:, j]), j])


def _dead(name: str, reference: str, j: int, stuck: list[tuple[int, int]], known: FloatArray) -> Finding:
    """Return the finding of joint j, from the stretches in which its reading (known,) stays."""
    count, dead = sum(stop - start for start, stop in stuck), bool((known == known[0]).all())
    where = "never changes" if dead else f"is frozen in {count} samples, from row {stuck[0][0]} on,"
    hint = "Is its encoder dead? Mend it and record anew" + ("." if dead else ", or leave these rows out.")
    # A motor that stands for a while, although sent elsewhere, may be braked: that is the robot's, not its encoder's.
    many = name == "external_jp" and count > MANY_MISSING * len(known)
    severity: Severity = "error" if dead or many else "warning"
    what = f"joint {j + 1} {where} while {reference} moves."
    return Finding(severity, "joint_dead", name, what, hint, count, [start for start, _ in stuck])


@check
def _joint_late(evidence: Evidence) -> Iterator[Finding]:
    """Ask whether each outside reading is as late as those of the other joints."""
    for offset in evidence.offsets:
        if offset.observed != "external_jp" or not np.isfinite(offset.offset):
            continue
        if min(evidence.tables[name].shape[1] for name in (offset.observed, offset.reference)) < 3:
            continue  # of two, none tells which is late
        delays, halves = joint_delays(evidence.log, offset.observed, offset.reference, offset.offset)
        shown = np.flatnonzero(np.isfinite(delays).all(axis=0))
        least = max(LATE[offset.reference], evidence.typical_step)
        for j in shown if len(shown) > 2 else ():
            others = delays[:, shown[shown != j]]
            late = delays[:, j] - np.median(others, axis=1)
            # Others that do not agree either say that slack or creep is what delays them.
            sure = (np.abs(late) - halves[:, j] > least).all() and (np.ptp(others, axis=1) <= least).all()
            if not sure or abs(late[0] - late[1]) > least + halves[:, j].sum():
                continue
            size = f"{1e3 * abs(late.mean()):.0f} ms {'later' if late[0] > 0 else 'earlier'}"
            what = f"joint {j + 1} is {size} than the other joints are, behind {offset.reference}."
            hint = "If its encoder, filter or clock is late, shift its column by that; --time-offset shifts all joints."
            yield Finding("error", "joint_late", offset.observed, what, hint, len(evidence.log))


def joint_delays(log: CalibrationLog, observed: str, reference: str, start: float) -> tuple[FloatArray, FloatArray]:
    """Return how far each joint is behind its motor, and half the width of the 95 % interval: `(2, d)` each, s.

    Of the first and of the second half of the recording, for a delay stays as it is. NaN where a joint does not show
    its own. Slack, and what other joints' motors do to it, are fitted beside it.

    Parameters
    ----------
    log : CalibrationLog, with a clock
    observed, reference : str, joint signals
    start : float, delay of all joints together, s
    """
    values, seen = getattr(log, reference), getattr(log, observed)
    joints = min(values.shape[1], seen.shape[1])
    delays, halves = np.full((2, 2, joints), np.nan)
    span = np.ptp(values[np.isfinite(values).all(axis=1)], axis=0)
    moving = np.flatnonzero(span > STILL * span.max(initial=0.0))
    for part, rows in enumerate(np.array_split(np.arange(len(log)), 2)):
        some = log.select(rows[:MOST])
        if sum(np.ptp(some.time[r]) for r in clock_runs(some)) < LEAST_SECONDS:
            continue
        q, y = (getattr(some, name)[:, moving] / span[moving] for name in (reference, observed))
        for k, joint in enumerate(moving[moving < joints]):
            known = y[np.isfinite(y[:, k]), k]
            if (known == known[:1]).all():  # missing, or dead
                continue
            pairs = [
                MotionPair(Motion(some.time[r], q[r]), Motion(some.time[r], y[r, k : k + 1])) for r in clock_runs(some)
            ]
            found = Timing(pairs).refine(np.array([start]), BRACKET)
            if found is not None and found.explained > FOLLOWS:
                delays[part, joint], halves[part, joint] = found.timing[0], found.half_width()[0]
    return delays, halves


def _moved_on(part: FloatArray, whole: FloatArray, least: float) -> bool:
    """Whether a motor covered, in a part of its path, more than any slack."""
    covered, span = (float(np.ptp(x[np.isfinite(x)])) if np.isfinite(x).any() else 0.0 for x in (part, whole))
    return covered > max(DEAD_TRAVEL * span, least)
