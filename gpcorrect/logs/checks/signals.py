"""Checks of signals by themselves: missing, constant, copied, frozen, impossibly fast."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gpcorrect.logs.checks.evidence import JOINT_POSITIONS, Evidence, Finding, Severity, check
from gpcorrect.logs.copies import OUTSIDE, stretches
from gpcorrect.logs.mocap.take import RIGID, typical_misfit
from gpcorrect.logs.sync import REFERENCES
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray

MANY_MISSING = 0.1  # of the samples: more than an occlusion now and then
MOSTLY = 0.5  # of a trajectory, from which it is a copy of others
COPIED = 0.99  # of the samples equal to the last bit: two sensors never agree so well
FROZEN_SAMPLES = 5  # repeats in a row; noise alone makes a living sensor differ sooner
MOVED_POSE = 1e-3  # m that the reference must have moved meanwhile: five times a good tracker's noise
MOVED_JOINT = np.deg2rad(1.0)  # rad, and m times ten
HELD_SHARE = 0.3  # of samples that repeat the one before while the robot moves: the rule, not the exception
HELD_RUNS = 10  # a held signal repeats often,
HELD_SPREAD = 2.0  # and nine runs in ten are at most so many times the usual one
HELD_FACTOR = 4.0  # a run this many times longer than the usual one is frozen even so
FEW_COUNTS = 10.0  # from row to row, of an encoder that repeats counts in a third of the rows
MOVES = ("setpoint_cp", "setpoint_jp", "measured_cp", "measured_jp")  # what says that a robot moves
WHOLE = 0.02  # of a count: a step is one of counts by a chance of one in 25
FASTEST_TIP = 2.0  # m/s; surgical arms stay below one
FASTEST_JOINT = {"R": (20.0, "rad/s"), "P": (2.0, "m/s")}  # chosen by hand, above any surgical arm
MANY_JUMPS = 0.2  # of the samples; fewer are outliers, which cleaning is for


@check
def _purpose(evidence: Evidence) -> Iterator[Finding]:
    """Ask whether the log holds what was commanded and what came of it."""
    if not any(name in evidence.present for name in ("setpoint_cp", "setpoint_jp")):
        what = "there is no command (setpoint_cp or setpoint_jp)."
        yield Finding("warning", "no_command", "", what, "A correction of the command cannot be learned from it.")
    if not any(name in evidence.present for name in OUTSIDE):
        what = "there is no outside measurement (tracker_cp or external_jp)."
        hint = "What the robot reports goes through the same wrong model; record a tracker as well."
        yield Finding("warning", "no_observation", "", what, hint)


@check
def _rows_apart(evidence: Evidence) -> Iterator[Finding]:
    """Ask whether any row holds what the tracker saw beside something of the robot."""
    robot = evidence.present - {*OUTSIDE, *evidence.log.SCALARS}
    seen = evidence.known.get("tracker_cp")
    if robot and seen is not None and seen.any() and not any((seen & evidence.known[name]).any() for name in robot):
        what = "no row holds it and a signal of the robot: the two stand on rows of their own."
        hint = "Write the tracker's rows to a file of their own, and give it with --tracker-log."
        yield Finding("error", "rows_apart", "tracker_cp", what, hint, int(seen.sum()))


@check
def _missing(evidence: Evidence) -> Iterator[Finding]:
    """Find samples in which a signal has no value."""
    for name in evidence.log.signals:
        lost = ~evidence.known[name]
        rows = np.flatnonzero(lost)
        if not rows.size:
            continue
        fraction = rows.size / len(lost)
        severity: Severity = "error" if fraction == 1.0 else "warning" if fraction > MANY_MISSING else "info"
        longest = int(np.diff(runs(lost), axis=1).max())
        what = f"{rows.size} of {len(lost)} samples ({fraction:.1%}) are missing, at most {longest} in a row."
        yield Finding(severity, "missing", name, what, "", rows.size, rows)


@check
def _constant(evidence: Evidence) -> Iterator[Finding]:
    """Find motion signals that never change: an error where the robot moved, else a warning."""
    motions = [n for n in (*evidence.log.POSES, *evidence.log.JOINTS) if n in evidence.present]
    still = [n for n in motions if _still(evidence, n)]
    for name in still:
        others = [n for n in motions if n not in still and n.rsplit("_")[-1] == name.rsplit("_")[-1]]
        severity: Severity = "error" if others else "warning"
        also = f", while {others[0]} does" if others else ""
        yield Finding(severity, "constant", name, f"it never changes{also}.", "", len(evidence.log))


def _still(evidence: Evidence, name: str) -> bool:
    table = evidence.tables[name][evidence.known[name]]
    return len(table) > 1 and bool((table == table[0]).all())


@check
def _loopback(evidence: Evidence) -> Iterator[Finding]:
    """Find copies among signals of different sources: no sensor repeats a command to the last bit."""
    for name, source in evidence.both((n, s) for n, sources in REFERENCES.items() for s in sources):
        if _still(evidence, name):
            continue
        a, b = evidence.tables[name], evidence.tables[source]
        columns = min(a.shape[1], b.shape[1])
        both = evidence.known[name] & evidence.known[source]
        same = (a[both, :columns] == b[both, :columns]).all(axis=1)
        if same.size and same.mean() > COPIED:
            severity: Severity = "error" if name in OUTSIDE else "warning"
            what = f"it is a copy of {source} in {same.mean():.1%} of the samples: nothing was measured."
            yield Finding(severity, "loopback", name, what, "", int(same.sum()))


@check
def _twice(evidence: Evidence) -> Iterator[Finding]:
    """Find trajectories that hold the samples of another one: copied, or recorded once and written twice."""
    log = evidence.log
    for name in (n for n in OUTSIDE if n in evidence.present):
        rows, marks = stretches(log, name)
        _, place, counts = np.unique(marks, return_inverse=True, return_counts=True)
        numbers, own = np.unique(log.trajectory[rows], return_inverse=True)
        share = np.bincount(own, counts[place] > 1, len(numbers)) / np.maximum(np.bincount(own), 1)
        copies = numbers[share > MOSTLY]
        if copies.size:
            what = f"in {copies.size} of {len(log.trajectory_ids)} trajectories it has the samples of another one."
            hint = "Leave the copies out: errors on them are those of a model that knows the answers."
            yield Finding("error", "twice", name, what, hint, copies.size, copies)


@check
def _frozen(evidence: Evidence) -> Iterator[Finding]:
    """Find sensors that repeat a value to the last bit while the robot moves: blind, or held between samples."""
    for name in REFERENCES:
        reference = _command_first(evidence, name)
        if reference is None:
            continue
        same, moves, usual = _holds(evidence, name, reference)
        repeated = runs(same)
        least = max(FROZEN_SAMPLES, HELD_FACTOR * usual)
        stuck = [r for r in repeated if r[1] - r[0] >= least and _displaced(evidence, reference, r)]
        if stuck:
            lengths = [int(stop - start) for start, stop in stuck]
            what = (
                f"it is frozen {len(stuck)} times while {reference} moves, for {max(lengths)} samples at most and "
                f"{sum(lengths)} in all."
            )
            hint = "The tracker lost its target and repeated the last value: leave these samples out."
            yield Finding("warning", "frozen", name, what, hint, sum(lengths), [start for start, _ in stuck])
        if usual:
            held = same[moves]
            times = 1.0 / max(1.0 - float(held.mean()), 1.0 / len(held))
            what = f"each value is repeated about {times:.2g} times: it was held between slower samples."
            hint = (
                "Leave the repeats empty, or record it with its own stamps: holding delays it by half its period, and "
                "its steps look like faults."
            )
            severity: Severity = "error" if name in OUTSIDE else "warning"
            yield Finding(severity, "held", name, what, hint, int(held.sum()))


def held_rows(log: CalibrationLog, name: str) -> BoolArray:
    """Return the mask `(n,)` of rows in which a sensor held between slower samples says its last value again.

    None of one that counts in steps, which may be as regular: it repeats what it reads.

    Parameters
    ----------
    log : CalibrationLog
    name : str, signal of a sensor
    """
    evidence = Evidence(log)
    reference = _command_first(evidence, name)
    if reference is None:
        return np.zeros(len(log), dtype=np.bool_)
    same, _, usual = _holds(evidence, name, reference)
    table = evidence.tables[name]
    steps = np.abs(table - table[evidence.previous])[evidence.previous >= 0]
    counts = all(_are_counts(column[column > 0.0]) for column in steps.T)
    return same & (usual > 0.0 and not counts)


def _are_counts(steps: FloatArray) -> bool:
    """Whether steps are small multiples of the smallest."""
    counts = steps / steps.min(initial=np.inf)
    whole = np.isclose(counts, np.round(counts), rtol=0.0, atol=WHOLE)
    return bool(not counts.size or (np.median(counts) < FEW_COUNTS and whole.mean() > 1.0 - HELD_SHARE))


def _command_first(evidence: Evidence, name: str) -> str | None:
    """Return the signal by which the robot moves: its command where that is known, as the sensor has it or otherwise.

    A robot whose log has joints only moves its tracker as well.
    """
    known = (r for r in (*reversed(REFERENCES[name]), *MOVES) if r != name and {name, r} <= evidence.present)
    return next(known, None)


def _holds(evidence: Evidence, name: str, reference: str) -> tuple[BoolArray, BoolArray, float]:
    """Rows that repeat the one before, those in which the robot moves, and the usual number of repeats; 0 for none."""
    same = _repeats(evidence, name)
    moves = ~_repeats(evidence, reference) & np.isfinite(evidence.steps) & evidence.known[reference]
    lengths = np.diff(runs(same), axis=1)[:, 0]
    if len(lengths) < HELD_RUNS or not moves.any() or same[moves].mean() <= HELD_SHARE:
        return same, moves, 0.0
    usual = float(np.median(lengths))
    return same, moves, usual if np.percentile(lengths, 90) <= HELD_SPREAD * usual else 0.0


def _repeats(evidence: Evidence, name: str) -> BoolArray:
    """(n,) mask of rows that equal the row before in the same trajectory to the last bit."""
    table = evidence.tables[name]
    return np.asarray((evidence.previous >= 0) & (table == table[evidence.previous]).all(axis=1))


def _displaced(evidence: Evidence, reference: str, run: IntArray) -> bool:
    """Whether the reference moved clearly from the sample that is repeated to the last repetition."""
    part = evidence.tables[reference][run[0] - 1 : run[1]]
    part = part[np.isfinite(part).all(axis=1)]
    if len(part) < 2:
        return False
    if reference in evidence.log.POSES:
        return bool(np.linalg.norm(part[:, :3] - part[0, :3], axis=1).max() > MOVED_POSE)
    kinds = evidence.joint_types.ljust(part.shape[1])[: part.shape[1]]
    scale = np.where(np.array(list(kinds)) == "P", 10.0, 1.0)
    return bool((scale * np.abs(part - part[0])).max() > MOVED_JOINT)


@check
def _speed(evidence: Evidence) -> Iterator[Finding]:
    """Find motions faster than an arm is."""
    for name in (*evidence.log.POSES, *JOINT_POSITIONS):
        if name not in evidence.present:
            continue
        if name in evidence.log.POSES:
            yield from _fast(name, "", evidence.speed(evidence.positions[name]), FASTEST_TIP, "m/s")
            continue
        table = evidence.tables[name]
        for j, kind in enumerate(evidence.joint_types[: table.shape[1]]):
            yield from _fast(name, f"joint {j + 1}: ", evidence.speed(table[:, [j]]), *FASTEST_JOINT[kind])


def _fast(name: str, where: str, speed: FloatArray, limit: float, unit: str) -> Iterator[Finding]:
    rows = np.flatnonzero(speed > limit)
    if not rows.size:
        return
    fraction = rows.size / max(int(np.isfinite(speed).sum()), 1)
    severity: Severity = "error" if fraction > MANY_JUMPS else "warning"
    kind = "jumps" if severity == "warning" else "moves"
    count = f"{rows.size} samples ({fraction:.2%})"
    what = f"{where}it {kind} faster than {limit:g} {unit} in {count}, up to {float(speed[rows].max()):.3g}."
    hint = "Cleaning drops lone jumps; many of them mean a wrong unit or bad stamps."
    yield Finding(severity, "speed", name, what, hint, rows.size, rows)


@check
def _marker_misfit(evidence: Evidence) -> Iterator[Finding]:
    """Find a marker tool that bends, or whose markers are mislabelled."""
    misfit = typical_misfit(evidence.log.extra.get("marker_rms", np.empty(0)))
    if misfit > RIGID:
        what = f"in a tenth of the frames the markers are {1e3 * misfit:.3g} mm or more from a rigid tool."
        hint = "Leave out the marker that moves, or label the markers anew."
        yield Finding("warning", "marker_misfit", "tracker_cp", what, hint)


def runs(mask: BoolArray) -> IntArray:
    """Return unbroken runs of True as `(r, 2)`: first row, and the row after the last.

    Parameters
    ----------
    mask : (n,) bool array
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return edges.reshape(-1, 2)
