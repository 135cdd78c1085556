"""Checks of time: order, unit, rate and gaps of the stamps, cutting into trajectories, offsets between clocks."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gpcorrect.logs.checks.evidence import JOINT_POSITIONS, Evidence, Finding, Severity, check, extent
from gpcorrect.logs.order import LEAVE_OUT
from gpcorrect.logs.sync import TimeOffset, log_offset, rough_offsets
from gpcorrect.velocity import GAP_STEPS

MAX_JITTER = 0.25  # of the median step, between the 5th and 95th percentile: real clocks stay well below
LONGEST_STEP = 600.0  # s; no one records a motion at a sample in ten minutes
EPOCH_UNITS = ((1e17, "nanoseconds", 1e-9), (1e14, "microseconds", 1e-6), (1e11, "milliseconds", 1e-3))
STEP_UNITS = ((2e5, "nanoseconds", 1e-9), (LONGEST_STEP, "microseconds", 1e-6))
SLOWEST_MILLISECOND = 0.5  # steps of 0.5 to 100, read as seconds, are 2000 to 10 Hz in milliseconds
FASTEST_CREEP = 5e-4  # m/s; a robot that was recorded moving is faster at times: the slowest real log is by 14
FASTEST_TURN = 5e-3  # rad/s of the fastest joint, of logs without poses: the slowest real log is faster by 40
BUSY = 90.0  # per cent of speeds below the one that is looked at: up to a tenth may be faults of the tracker
MIN_TRAVEL = 5e-3  # m or rad; below it speeds are not looked at
SHORT = 10  # samples of a trajectory; a five-point derivative then rests on one-sided ends
SERVO = (("measured_cp", "setpoint_cp"), ("measured_jp", "setpoint_jp"))
SAME_CLOCK = ("measured_cp", "measured_jp")  # stamped by the robot, as its commands are
AHEAD = 5e-3  # s: more than cycles of a controller and rounding of stamps; 24 simulated and real logs lag by 0 to 47 ms
MAX_OFFSET = 1.0  # median steps; a larger offset moves a sample to its neighbour's place


@check
def _stamps(evidence: Evidence) -> Iterator[Finding]:
    """Ask whether time is there and increases inside a trajectory."""
    if evidence.log.static:
        yield Finding("info", "static", "time", "static poses, no clock: times and speeds are not looked at.")
    hint = f"Give each motion its own trajectory number, or {LEAVE_OUT}."
    missing, steps = ~np.isfinite(evidence.log.time), evidence.steps
    found = (
        ("stamp_missing", missing, "have no time."),
        ("stamp_repeated", steps == 0, "have the time of the sample before."),
        (
            "stamp_backward",
            steps < 0,
            f"are earlier than the one before, by up to {-np.nanmin(steps, initial=0):.3g} s.",
        ),
    )
    for code, mask, what in found:
        rows = np.flatnonzero(mask)
        if rows.size:
            yield Finding("error", code, "time", f"{rows.size} samples {what}", hint, rows.size, rows)


@check
def _time_unit(evidence: Evidence) -> Iterator[Finding]:
    """Ask whether time is in seconds."""
    step = evidence.typical_step
    if not np.isfinite(step):
        return
    stamp = float(np.median(np.abs(evidence.log.time[np.isfinite(evidence.log.time)])))
    sizes = ((EPOCH_UNITS, stamp), (STEP_UNITS, step))
    by_size = ((unit, scale) for table, value in sizes for limit, unit, scale in table if value > limit and step >= 1.0)
    guess = next(by_size, None)
    if guess is None and step >= SLOWEST_MILLISECOND and _creeps(evidence):
        guess = "milliseconds", 1e-3
    if guess is not None:
        what = f"time looks like {guess[0]}, not seconds: its median step is {step:.4g}."
        hint = f"Set time_scale = {guess[1]:g} in the mapping file."
        yield Finding("error", "time_unit", "time", what, hint, len(evidence.log))


def _creeps(evidence: Evidence) -> bool:
    """Whether every pose, or joint where there are no poses, that moves does so at no speed worth the name."""
    moves = [evidence.positions[name] for name in evidence.log.POSES if name in evidence.present]
    limit = FASTEST_CREEP if moves else FASTEST_TURN
    if not moves:
        joints = [n for n in JOINT_POSITIONS if n in evidence.present]
        moves = [column[:, None] for n in joints for column in evidence.tables[n].T]
    speeds = [evidence.speed(values) for values in moves if extent(values) > MIN_TRAVEL]
    known = [s[np.isfinite(s)] for s in speeds]
    return bool(known) and all(len(s) and np.percentile(s, BUSY) < limit for s in known)


@check
def _jitter(evidence: Evidence) -> Iterator[Finding]:
    """Ask whether sampling is even."""
    forward = evidence.steps[evidence.steps > 0]
    if forward.size < 10:
        return
    low, middle, high = np.percentile(forward, [5, 50, 95])
    if high - low > MAX_JITTER * middle:
        what = f"it is irregular: 9 of 10 steps take {low:.3g} to {high:.3g} s, median {middle:.3g} s."
        hint = "They are used as they are: stamps should tell when a sample was taken, not when it came."
        yield Finding("warning", "irregular", "time", what, hint, forward.size)


@check
def _gaps(evidence: Evidence) -> Iterator[Finding]:
    """Find pauses of the recording, by the rule that velocities and interpolation also break at."""
    gap = np.zeros(len(evidence.log), dtype=np.bool_)
    for _, rows in evidence.log.trajectories():
        step = evidence.steps[rows]
        gap[rows] = step > GAP_STEPS * np.median(step[step > 0]) if (step > 0).any() else False
    rows = np.flatnonzero(gap)
    if rows.size:
        longest = float(evidence.steps[rows].max())
        what = f"{rows.size} pauses of more than {GAP_STEPS:g} median steps, the longest {longest:.3g} s."
        yield Finding(
            "warning", "gap", "time", what, "No velocity or interpolation is taken across them.", rows.size, rows
        )


@check
def _trajectories(evidence: Evidence) -> Iterator[Finding]:
    """Ask whether there are several trajectories, each in one piece and long enough to differentiate."""
    log = evidence.log
    if log.static:
        return
    numbers, sizes = np.unique(log.trajectory, return_counts=True)
    if len(numbers) == 1:
        what = "there is only one trajectory: errors are measured on a block of it, and intervals have little to go by."
        yield Finding("warning", "one_trajectory", "trajectory", what, "Cut the log, or join several.", 1)
    short = numbers[sizes < SHORT]
    if short.size:
        what = f"{short.size} of {len(numbers)} trajectories have fewer than {SHORT} samples."
        yield Finding("warning", "short_trajectory", "trajectory", what, "", short.size, short)
    starts = np.concatenate([log.trajectory[:1], log.trajectory[np.flatnonzero(np.diff(log.trajectory)) + 1]])
    torn = numbers[[(starts == n).sum() > 1 for n in numbers]]
    if torn.size:
        what = f"{torn.size} trajectories are interrupted by another one."
        hint = "Give each motion its own number: a number that comes back is taken for the same motion."
        yield Finding("warning", "torn_trajectory", "trajectory", what, hint, torn.size, torn)


@check
def _clock_offset(evidence: Evidence) -> Iterator[Finding]:
    """Ask whether command and observation are on one clock."""
    for offset in evidence.offsets:
        if offset.observable:
            yield _offset(offset, evidence.typical_step)
        elif offset.verdict != "unrelated":
            what = f"its time offset is not observable: {offset.reason}"
            severity: Severity = "warning" if offset.verdict == "edge" else "info"
            yield Finding(severity, "time_offset_unknown", offset.observed, what)
        if offset.drift is not None:
            what = f"its clock runs {offset.drift.ppm:+.1f} ppm against that of {offset.reference}."
            yield Finding(
                "warning",
                "clock_drift",
                offset.observed,
                what,
                "Give --time-offset motion: no lag that is learned follows a clock.",
            )


def _offset(offset: TimeOffset, step: float) -> Finding:
    half = 500 * (offset.ci95[1] - offset.ci95[0])
    side = "behind" if offset.offset >= 0 else "ahead of"
    what = (
        f"it is {1e3 * abs(offset.offset):.1f} ms {side} {offset.reference} (95 %: +-{half:.2g} ms, "
        f"{abs(offset.offset) / step:.2g} samples)"
    )
    if offset.observed in SAME_CLOCK:
        return Finding("info", "servo_lag", offset.observed, f"{what}: the lag of the robot, on one clock.")
    severity: Severity = "warning" if abs(offset.offset) > MAX_OFFSET * step else "info"
    like = "A lag of the robot or backlash looks the same from motion alone."
    if severity == "warning" and offset.ci95[1] < 0:  # slow real recordings are ahead by a fraction of a sample
        like = "No lag of the robot or backlash looks so; rows in reversed time do."
    hint = f"If this is the clocks: --time-offset motion. {like}"
    return Finding(severity, "time_offset", offset.observed, f"{what}.", hint)


@check
def _exchanged(evidence: Evidence) -> Iterator[Finding]:
    """Ask whether the robot moves after its command, and not before: then the two signals are exchanged."""
    for observed, reference in () if evidence.log.static else evidence.both(SERVO):
        rough = min(rough_offsets(evidence.log, observed, reference), key=abs, default=-np.inf)
        if rough - 0.5 * evidence.typical_step > -AHEAD:  # within half a step of it: saves its refinement
            continue
        known = (o for o in evidence.offsets if (o.observed, o.reference) == (observed, reference))
        offset = next(known, None) or log_offset(evidence.log, observed, reference)
        if offset.observable and offset.ci95[1] < -AHEAD:
            what = f"it comes {1e3 * -offset.offset:.1f} ms after {observed}, and no robot moves before its command."
            yield Finding("error", "exchanged", reference, what, "Are the columns, or topics, of the two exchanged?")
