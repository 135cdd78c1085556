"""Checks of rotations, and that signals belong together: the same arm, handedness, and point of the tool."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gpcorrect import se3
from gpcorrect.arms import RemoteCentreArm, arm_named
from gpcorrect.logs.checks.evidence import MIN_PAIRED, Evidence, Finding, Severity, check, spread
from gpcorrect.logs.checks.one_joint import turned_joints
from gpcorrect.logs.sync import TimeOffset
from gpcorrect.types import QUATERNION_TOLERANCE, BoolArray, FloatArray

MANY_BAD = 0.01  # of the samples; fewer are glitches
MIN_TURN = np.deg2rad(5.0)  # an orientation that varies less may be all noise
COMPARED = 2000  # poses; more say nothing new
PAIRS = (("setpoint_cp", "setpoint_jp"), ("measured_cp", "measured_jp"), ("tracker_cp", "external_jp"))
ARM_NAMES = ("raven2_left", "raven2_right", "dvrk_psm")
MIN_MISFIT = 5e-3  # m; another tool on the same arm shifts the tip by less over a workspace
BETTER = 0.3  # another arm must fit this much better
WRIST_MISFIT = 5e-4  # m; below it the tip fits
CLEARLY = 0.1  # the wrist point must fit ten times better than the tip
CLEARER = 0.7  # of what the best rotation leaves: 56 simulated and real logs that are right leave 0.95 and more
MAX_LEFT = 0.5  # of the spread, that a reflection may leave: of what is unrelated it leaves all
ROBUST_STEPS = 30  # of reweighting
EXACT = 1e-12  # of the largest number, below which all weigh alike
FLAT = 0.3  # of the median distance, below which all weigh alike
FOLLOWING = 0.5  # of the spread of the positions: what is left of it where one signal follows the other


@check
def _quaternion_norm(evidence: Evidence) -> Iterator[Finding]:
    """Ask whether quaternions have norm one."""
    for name, quaternion in evidence.quaternions.items():
        norm = np.linalg.norm(quaternion, axis=1)
        known = np.isfinite(norm)
        rows = np.flatnonzero(known & (np.abs(norm - 1) > QUATERNION_TOLERANCE))
        if rows.size:
            fraction = rows.size / int(known.sum())
            severity: Severity = "error" if fraction > 0.5 else "warning" if fraction > MANY_BAD else "info"
            worst = norm[rows][np.argmax(np.abs(norm[rows] - 1))]
            what = f"{rows.size} quaternions ({fraction:.1%}) do not have norm 1; the worst has {worst:.4g}."
            yield Finding(severity, "quaternion_norm", name, what, "", rows.size, rows)


@check
def _quaternion_sign(evidence: Evidence) -> Iterator[Finding]:
    """Find jumps between a quaternion and its negative: one rotation, harmless here, but not everywhere."""
    for name, quaternion in evidence.quaternions.items():
        aligned = np.einsum("ij,ij->i", quaternion, quaternion[evidence.previous])
        rows = np.flatnonzero((aligned < 0) & (evidence.previous >= 0))
        if rows.size:
            what = f"the sign of the quaternion flips {rows.size} times; as rotations these are no jumps."
            yield Finding("info", "quaternion_sign", name, what, "", rows.size, rows)


@check
def _inverted(evidence: Evidence) -> Iterator[Finding]:
    """Ask whether two records of one rotation turn the same way.

    Another frame and another mounting rotate the four numbers of all quaternions alike. The inverse is a reflection of
    them, and so are components read in cyclic order (xyzw for wxyz).
    """
    signals = {n: q for n, q in evidence.quaternions.items() if n in evidence.present}
    reference = next((n for n in ("setpoint_cp", "measured_cp") if n in signals), None)
    for name in ("tracker_cp", "measured_cp"):
        if reference is None or name not in signals or name == reference:
            continue
        if _turns_otherwise(signals[reference], signals[name]):
            what = f"it turns the other way than {reference}."
            hint = "Are the quaternions xyzw, not wxyz? Or the poses of the frame seen by the tool?"
            yield Finding("error", "orientation_inverted", name, what, hint, len(evidence.log))


def _turns_otherwise(reference: FloatArray, observed: FloatArray) -> bool:
    rows = np.flatnonzero(_usable(reference) & _usable(observed))
    if rows.size < 2:
        return False
    rows = rows[np.linspace(0, rows.size - 1, min(rows.size, COMPARED)).astype(int)]
    R = se3.matrix_from_quaternion(reference[rows])
    turned = bool(np.median(se3.angle(se3.rotation_mean(R).T @ R)) > MIN_TURN)
    return turned and _mirrored(reference[rows], observed[rows], axial=True)


def _usable(quaternion: FloatArray) -> BoolArray:
    norm = np.linalg.norm(quaternion, axis=1)
    return np.asarray((norm > 0.5) & (norm < 2.0))


@check
def _handedness(evidence: Evidence) -> Iterator[Finding]:
    """Ask whether tracker and robot frames are both right-handed."""
    reference = next((n for n in ("setpoint_cp", "measured_cp") if n in evidence.present), None)
    if reference is None or "tracker_cp" not in evidence.present:
        return
    if _mirrored(evidence.positions[reference], evidence.positions["tracker_cp"]):
        what = f"it is a mirror image of {reference}: an axis is reversed, or two are exchanged."
        yield Finding("error", "mirrored", "tracker_cp", what, "Use a right-handed frame for the tracker.")


@check
def _kinematics(evidence: Evidence) -> Iterator[Finding]:
    """Ask whether poses follow from the joints by the arm that the sidecar names, up to where the base frame is."""
    arm = evidence.arm
    if arm is None:
        return
    for pose, joints in evidence.both(PAIRS):
        if evidence.tables[joints].shape[1] < arm.dof:
            continue
        position, q = evidence.positions[pose], evidence.tables[joints][:, : arm.dof]
        misfit = _rigid_misfit(_points(arm, q), position)
        size = f"{1e3 * misfit:.1f} mm"
        if misfit > WRIST_MISFIT and _rigid_misfit(_points(arm, q, wrist=True), position) < CLEARLY * misfit:
            what = f"it holds the wrist point, {size} off the tip: no one rigid body with its orientations."
            yield Finding("warning", "wrist_point", pose, what, "Register position and orientation separately.")
        elif misfit > MIN_MISFIT:
            others = [other for n in ARM_NAMES if (other := arm_named(n)).name != arm.name and other.dof == arm.dof]
            fits = (o for o in others if _rigid_misfit(_points(o, q), position) < BETTER * misfit)
            better = next(fits, None)
            if better is None:
                where = f"where {joints} puts the tip of {arm.name}, after the best base registration"
                what = f"it is {size} off from {where}."
                yield Finding(
                    "warning", "kinematics", pose, what, "Another tool, joint offsets, or signals of two arms."
                )
            else:
                what = f"it follows from {joints} by the kinematics of {better.name}, not of {arm.name} ({size} off)."
                hint = "Correct the arm in the sidecar, or the log's source."
                yield Finding("error", "swapped_arm", pose, what, hint)


def _points(arm: RemoteCentreArm, q: FloatArray, *, wrist: bool = False) -> FloatArray:
    """Tips, or wrist points, `(n, 3)` of the arm at joints `(n, dof)`; NaN where a joint is missing."""
    result = np.full((len(q), 3), np.nan)
    known = np.isfinite(q).all(axis=1)
    result[known] = arm.wrist(q[known]) if wrist else arm.forward(q[known])[:, :3, 3]
    return result


@check
def _unrelated(evidence: Evidence) -> Iterator[Finding]:
    """Ask whether what was observed is the motion that was commanded, at some shift in time."""
    turned = {name for name, _ in turned_joints(evidence)}  # said by themselves
    for offset in evidence.offsets:
        if offset.verdict != "unrelated" or offset.observed in turned:
            continue
        if _follows(evidence, offset):
            what = "its time offset is not observable: its speed is not that of the command, though its place is."
            hint = "Faults of the tracker hide the speed; cleaning drops them."
            yield Finding("warning", "time_offset_unknown", offset.observed, what, hint)
        else:
            hint = "Is it the log of the other arm, are the clocks seconds apart, or could the arm not follow?"
            yield Finding("error", "unrelated", offset.observed, offset.reason, hint, len(evidence.log))


def _follows(evidence: Evidence, offset: TimeOffset) -> bool:
    """Whether most observed positions lie where the command puts them, as they stand in the table."""
    if offset.observed not in evidence.log.POSES or offset.reference not in evidence.log.POSES:
        return False
    observed = evidence.positions[offset.observed]
    return _rigid_misfit(evidence.positions[offset.reference], observed) < FOLLOWING * spread(observed)


def alike(one: FloatArray, other: FloatArray) -> bool:
    """Whether one path is the other one moved, turned and scaled, faults aside.

    Parameters
    ----------
    one, other : (n, 3) arrays, NaN where missing
    """
    x, y = (points / max(spread(points), np.finfo(float).tiny) for points in (one, other))
    return _rigid_misfit(x, y) < FOLLOWING


def _rigid_misfit(points: FloatArray, target: FloatArray) -> float:
    """Median distance, m, left by the best rigid motion of points onto targets, faults aside; NaN for too few."""
    known = np.isfinite(points).all(axis=1) & np.isfinite(target).all(axis=1)
    if known.sum() < MIN_PAIRED:
        return float("nan")
    return _misfit(points[known], target[known], 1.0, axial=False)


def _mirrored(reference: FloatArray, observed: FloatArray, *, axial: bool = False) -> bool:
    """Whether a reflection takes points onto others clearly better than any rotation does; no where it is unclear.

    Both are fitted with weights that faults of the tracker hardly have (least absolute distances).
    """
    known = np.isfinite(reference).all(axis=1) & np.isfinite(observed).all(axis=1)
    if known.sum() < MIN_PAIRED:
        return False
    x, y = reference[known], observed[known]
    if axial:
        x, y = _one_side(x), _one_side(y)
    else:  # about the median, in units of the spread
        x, y = ((v - np.median(v, axis=0)) / max(spread(v), np.finfo(float).tiny) for v in (x, y))
    rotated, reflected = (_misfit(x, y, sign, axial=axial) for sign in (1.0, -1.0))
    return reflected < CLEARER * rotated and reflected < MAX_LEFT * spread(y)


def _one_side(points: FloatArray) -> FloatArray:
    """Return points `(n, k)` of norm 1, all on one side of the origin."""
    unit: FloatArray = points / np.linalg.norm(points, axis=1, keepdims=True)
    side: FloatArray = unit @ np.linalg.svd(unit, full_matrices=False)[2][0]
    return unit * np.where(side < 0, -1.0, 1.0)[:, None]


def _misfit(x: FloatArray, y: FloatArray, sign: float, *, axial: bool) -> float:
    """Median distance that the best orthogonal map of this determinant leaves between points `(n, k)`; or NaN."""
    weight = np.ones(len(x))
    for _ in range(ROBUST_STEPS):
        total = weight.sum()
        a, b = (np.zeros(x.shape[1]) if axial else weight @ points / total for points in (x, y))
        products = (weight[:, None] * (y - b)).T @ (x - a)
        if not np.isfinite(products).all():  # numbers near the largest there are
            return float("nan")
        u, _, vt = np.linalg.svd(products)
        u[:, -1] *= sign * np.sign(np.linalg.det(u) * np.linalg.det(vt))
        fitted = (x - a) @ (u @ vt).T + b
        if axial:
            y = y * np.where(np.einsum("ij,ij->i", fitted, y) < 0, -1.0, 1.0)[:, None]
        distance = np.linalg.norm(y - fitted, axis=1)
        least = max(FLAT * float(np.median(distance)), EXACT * float(np.abs(y).max()))
        if least == 0.0:
            return 0.0
        weight = 1.0 / np.maximum(distance, least)
    return float(np.median(distance))
