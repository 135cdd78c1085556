"""Checks of units and limits, by sizes that no arm has and by ratios between signals of one motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from gpcorrect.logs.checks.evidence import (
    JOINT_POSITIONS,
    MIN_CORRELATION,
    MIN_PAIRED,
    Evidence,
    Finding,
    Severity,
    check,
    extent,
    spread,
)
from gpcorrect.logs.checks.geometry import alike
from gpcorrect.logs.checks.one_joint import turned_joints
from gpcorrect.types import FloatArray

WIDEST = 5.0  # m; no arm here reaches so far, and 5 mm is less than any workspace in millimetres
MIN_SPREAD = 1e-4  # m or rad; narrower signals are noise and their ratios mean nothing
DEGREES = 180 / np.pi  # in a radian
RATIOS = ((1000.0, 2.0), (DEGREES, 1.4))  # a unit's factor, and how far calibration errors may move the ratio
LENGTHS = (("1e-3", "millimetres"), ("0.01", "centimetres"), ("0.0254", "inches"))  # metres in one of each
OTHER_UNIT = 20.0  # times as large as the same motion elsewhere; an inch, the least unit, is 39
OTHER_SCALE = 2.0  # more than a robot errs, less than the foot's 3.3
UNLIKE = 0.5  # correlation of a joint with itself, below which it may be another one; in real recordings 0.85 and more
FULL_TURN = 2 * np.pi  # rad; surgical wrists turn less
LONGEST = 5.0  # m, of a prismatic joint
POSITION_PAIRS = (("tracker_cp", "setpoint_cp"), ("tracker_cp", "measured_cp"), ("measured_cp", "setpoint_cp"))
JOINT_PAIRS = (("measured_jp", "setpoint_jp"), ("external_jp", "setpoint_jp"), ("external_jp", "measured_jp"))
BEYOND = {"R": np.deg2rad(1.0), "P": 1e-3}  # encoders and servo overshoot pass soft limits by less
SHOWN = {"R": (np.rad2deg(1.0), "deg"), "P": (1e3, "mm")}


def _factor(ratio: float, factors: Sequence[tuple[float, float]]) -> float | None:
    """Return the unit's factor that a ratio stands for, None for none."""
    exact = (e for factor, tolerance in factors for e in (factor, 1 / factor) if e / tolerance < ratio < e * tolerance)
    return next(exact, None)


@check
def _position_unit(evidence: Evidence) -> Iterator[Finding]:
    """Ask whether positions are in metres: neither too wide, nor the motion of another signal at another size."""
    wide = [n for n in evidence.log.POSES if n in evidence.present and extent(evidence.positions[n]) > WIDEST]
    for name in wide:
        metres, unit = _length(evidence, name, wide)
        what = f"it spans {extent(evidence.positions[name]):.4g} m: it looks like {unit}."
        hint = f"Set position_scale = {metres} under [{name}] in the mapping file."
        yield Finding("error", "position_unit", name, what, hint, len(evidence.log))
    for name, other in evidence.both(POSITION_PAIRS):
        sizes = spread(evidence.positions[name]), spread(evidence.positions[other])
        if name in wide or other in wide or max(sizes) < MIN_SPREAD or min(sizes) == 0:
            continue
        times = sizes[0] / sizes[1]
        apart = max(times, 1 / times)
        thousand = _factor(times, RATIOS[:1]) is not None
        if not thousand and (apart < OTHER_SCALE or not alike(evidence.positions[name], evidence.positions[other])):
            continue
        severity: Severity = "error" if thousand or apart > OTHER_UNIT else "warning"
        doubt = "its scale is wrong, or it is a point farther from a pivot or nearer to it"
        why = "one of them is not in metres" if severity == "error" else doubt
        what = f"it varies {times:.3g} times as much as {other}: {why}."
        yield Finding(severity, "position_unit", name, what, "Check position_scale.", len(evidence.log))


def _length(evidence: Evidence, name: str, wide: Sequence[str]) -> tuple[str, str]:
    """Return the unit of positions that are too wide for metres: as a signal in metres has it, else millimetres."""
    metres = [spread(evidence.positions[n]) for n in evidence.log.POSES if n in evidence.present and n not in wide]
    if max(metres, default=0.0) < MIN_SPREAD:
        return LENGTHS[0]
    times = spread(evidence.positions[name]) / max(metres)
    return min(LENGTHS, key=lambda unit: abs(np.log(max(float(unit[0]) * times, np.finfo(float).tiny))))


@check
def _joint_unit(evidence: Evidence) -> Iterator[Finding]:
    """Ask whether joint positions are in radians and metres."""
    hint = (
        "Set scale for its column in the mapping file: 0.0174533 for degrees, 0.001 for mm."
        " A bag has no columns: gpcorrect convert BAG OUT.csv, and map OUT.csv."
    )
    for (name, joint), what in _misread_joints(evidence).items():
        yield Finding("error", "joint_unit", name, f"joint {joint + 1} {what}", hint, len(evidence.log))


def _misread_joints(evidence: Evidence) -> dict[tuple[str, int], str]:
    """Why each suspicious (signal, joint index) is not in rad or m: by itself, or against another signal of it."""
    found: dict[tuple[str, int], str] = {}
    turned = turned_joints(evidence)
    for name in JOINT_POSITIONS:
        if name in evidence.present:
            suspicious = _too_wide(evidence, name)
            found.update({(name, j): what for j, what in suspicious if (name, j) not in turned})
    for name, other in evidence.both(JOINT_PAIRS):
        for j, (a, b) in enumerate(zip(evidence.tables[name].T, evidence.tables[other].T, strict=False)):
            ratio, wide = _spread_ratio(a, b), max(spread(a[:, None]), spread(b[:, None]))
            unlike = np.isfinite(ratio) and wide > MIN_SPREAD and _factor(ratio, RATIOS) is not None
            if unlike and (other, j) not in found:
                what = f"varies {ratio:.3g} times as much as in {other}: they are not in the same unit."
                found.setdefault((name, j), what)
    return found


def _too_wide(evidence: Evidence, name: str) -> Iterator[tuple[int, str]]:
    table = evidence.tables[name][evidence.known[name]]
    kinds = evidence.joint_types or "?" * table.shape[1]
    for j, (kind, column) in enumerate(zip(kinds, table.T, strict=False)):
        size = float(np.percentile(np.abs(column), 99))
        if kind == "?" and size > max(FULL_TURN, LONGEST):
            yield j, f"reaches {size:.4g}: neither a turning joint in radians nor a sliding one in metres does."
        if kind == "R" and size > FULL_TURN:
            yield j, f"reaches {size:.4g}: it looks like degrees."
        if kind == "P" and size > LONGEST:
            yield j, f"reaches {size:.4g}: it looks like {_length_unit(evidence, j, column)}."


def _length_unit(evidence: Evidence, joint: int, column: FloatArray) -> str:
    """Millimetres, or the 180/pi times metres of RAVEN-II messages: what puts most samples within limits."""
    if evidence.arm is None or joint >= evidence.arm.dof:
        return "millimetres, or metres multiplied by 180/pi"
    low, high = evidence.arm.limits[joint]
    within = {
        unit: float(np.mean((column / factor >= low) & (column / factor <= high)))
        for unit, factor in (("millimetres", 1000.0), ("metres multiplied by 180/pi", DEGREES))
    }
    return max(within, key=lambda unit: within[unit])


@check
def _joint_sense(evidence: Evidence) -> Iterator[Finding]:
    """Ask whether each joint moves as itself in every signal, and the same way: signs and columns are mixed up."""
    turned = turned_joints(evidence)
    for name, other in evidence.both(JOINT_PAIRS):
        like = _likeness(evidence.tables[name], evidence.tables[other])
        for joint in np.flatnonzero(np.diag(like) < -MIN_CORRELATION):
            if (name, int(joint)) in turned:
                continue
            what = f"joint {joint + 1} moves the other way than in {other} (correlation {like[joint, joint]:.2f})."
            hint = "Set scale = -1 for its column in the mapping file, or for that of the other signal."
            yield Finding("error", "joint_sense", name, what, hint, len(evidence.log))
        for j, k in combinations(range(len(like)), 2):
            if max(like[j, j], like[k, k]) < UNLIKE and min(like[j, k], like[k, j]) > MIN_CORRELATION:
                what = f"joint {j + 1} moves as joint {k + 1} does in {other}, and joint {k + 1} as its joint {j + 1}."
                hint = "Exchange their columns in the mapping file."
                yield Finding("error", "joint_sense", name, what, hint, len(evidence.log))


def _likeness(a: FloatArray, b: FloatArray) -> FloatArray:
    """Correlation of each joint of a signal with each of another `(k, k)`; 0 where one hardly moves."""
    few = min(a.shape[1], b.shape[1])
    known = np.isfinite(a[:, :few]).all(axis=1) & np.isfinite(b[:, :few]).all(axis=1)
    if known.sum() < MIN_PAIRED:
        return np.zeros((few, few))
    x, y = (v[known, :few] for v in (a, b))
    moves = np.outer(x.std(axis=0) > MIN_SPREAD, y.std(axis=0) > MIN_SPREAD)
    with np.errstate(divide="ignore", invalid="ignore"):  # where one stands still
        return np.where(moves, np.corrcoef(x, y, rowvar=False)[:few, few:], 0.0)


@check
def _joint_limits(evidence: Evidence) -> Iterator[Finding]:
    """Ask whether joints stay within the arm's limits; those with a wrong unit are left to that check."""
    arm = evidence.arm
    if arm is None:
        return
    misread = _misread_joints(evidence)
    hint = "Check the arm's name in the sidecar, the joint order and the joint offsets."
    for name in (n for n in JOINT_POSITIONS if n in evidence.present):
        for j, q in enumerate(evidence.tables[name][:, : arm.dof].T):
            kind, (low, high) = arm.joint_types[j], arm.limits[j]
            beyond = np.maximum(np.maximum(low - q, q - high), 0.0)
            rows = np.flatnonzero(beyond > BEYOND[kind])
            if not rows.size or (name, j) in misread:
                continue
            fraction = rows.size / int(np.isfinite(q).sum())
            severity: Severity = "error" if fraction > 0.5 else "warning"
            scale, unit = SHOWN[kind]
            what = (
                f"joint {j + 1} leaves {scale * low:.4g} to {scale * high:.4g} {unit}, the limits of {arm.name}, "
                f"in {rows.size} samples ({fraction:.2%}), by up to {scale * float(np.nanmax(beyond)):.3g} {unit}."
            )
            yield Finding(severity, "joint_limit", name, what, hint, rows.size, rows)


def _spread_ratio(values: FloatArray, reference: FloatArray) -> float:
    """How many times wider values vary than a reference that they follow; NaN if they do not."""
    known = np.isfinite(values) & np.isfinite(reference)
    a, b = values[known], reference[known]
    if len(a) < MIN_PAIRED or np.ptp(a) == 0 or np.ptp(b) == 0:
        return float("nan")
    from scipy.stats import spearmanr  # half a second to import, and every recording that is read would pay it

    if abs(float(spearmanr(a, b).statistic)) < MIN_CORRELATION:
        return float("nan")
    wide_a, wide_b = (float(np.diff(np.percentile(x, [5, 95]))[0]) for x in (a, b))
    return wide_a / wide_b if wide_b > 0 else float("nan")
