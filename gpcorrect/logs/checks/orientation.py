"""Checks of quaternions: norm, sign, order of the components."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gpcorrect import se3
from gpcorrect.logs.checks.finding import Evidence, Finding, Severity, examples
from gpcorrect.types import FloatArray

__all__ = ["QuaternionNorm", "QuaternionOrder", "QuaternionSign"]

NORM_TOLERANCE = 1e-3  # the log format calls a sample bad beyond it
MANY_BAD = 0.01  # of the samples
MIN_TURN = np.deg2rad(10.0)  # an orientation that varies less does not show the order of its components
MIN_MISFIT = np.deg2rad(5.0)  # trackers and wrists differ by less between two poses, or by an outlier
BETTER = 0.3  # a swapped order must agree this much better
COMPARED = 400  # pairs of poses


def _with_quaternions(evidence: Evidence) -> Iterator[tuple[str, FloatArray]]:
    for name in evidence.log.POSES:
        signal = getattr(evidence.log, name)
        if signal is not None and signal.quaternion is not None:
            yield name, signal.quaternion


@dataclass(frozen=True)
class QuaternionNorm:
    """Quaternions have norm one."""

    tolerance: float = NORM_TOLERANCE

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield a finding for each signal with bad norms."""
        for name, quaternion in _with_quaternions(evidence):
            norm = np.linalg.norm(quaternion, axis=1)
            known = np.isfinite(norm)
            rows = np.flatnonzero(known & (np.abs(norm - 1) > self.tolerance))
            if rows.size:
                share = rows.size / max(int(known.sum()), 1)
                severity: Severity = "error" if share > 0.5 else "warning" if share > MANY_BAD else "info"
                worst = norm[rows][np.argmax(np.abs(norm[rows] - 1))]
                what = f"{rows.size} quaternions ({share:.1%}) do not have norm 1; the worst has {worst:.4g}."
                yield Finding(severity, "quaternion_norm", name, what, "", int(rows.size), examples(rows))


@dataclass(frozen=True)
class QuaternionSign:
    """A quaternion and its negative are one rotation; a jump between them is harmless here but not everywhere."""

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield how often the sign flips."""
        for name, quaternion in _with_quaternions(evidence):
            flips = np.zeros(len(quaternion), dtype=np.bool_)
            for _, rows in evidence.log.trajectories():
                flips[rows[1:]] = np.einsum("ij,ij->i", quaternion[rows[1:]], quaternion[rows[:-1]]) < 0
            rows = np.flatnonzero(flips)
            if rows.size:
                what = f"the sign of the quaternion flips {rows.size} times; rotations are continuous all the same."
                yield Finding("info", "quaternion_sign", name, what, "", int(rows.size), examples(rows))


@dataclass(frozen=True)
class QuaternionOrder:
    """Two records of one rotation turn by the same angle between any two samples, in whatever frames.

    A quaternion read in the wrong order (xyzw for wxyz) turns by another angle.
    """

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield a finding where another order of components agrees far better."""
        signals = {n: q for n, q in _with_quaternions(evidence) if evidence.has(n)}
        reference = next((n for n in ("setpoint_cp", "measured_cp") if n in signals), None)
        for name in ("tracker_cp", "measured_cp"):
            if reference is None or name not in signals or name == reference:
                continue
            swapped = _swapped(signals[name], signals[reference])
            if swapped:
                what = f"its rotations match those of {reference} only with {swapped} components in another order."
                hint = "Quaternions are qw, qx, qy, qz; read the source with quat_xyzw or quat_wxyz as it is."
                yield Finding("error", "quaternion_order", name, what, hint, len(evidence.log))


def _swapped(quaternion: FloatArray, reference: FloatArray) -> str:
    """Whose components are swapped, empty for neither."""
    norms = np.linalg.norm(np.hstack([quaternion, reference]), axis=1)
    rows = np.flatnonzero(
        np.isfinite(norms) & (np.abs(quaternion).max(axis=1) > 0) & (np.abs(reference).max(axis=1) > 0)
    )
    if rows.size < 2:
        return ""
    rows = rows[np.linspace(0, rows.size - 1, min(rows.size, COMPARED)).astype(int)]
    a, b = quaternion[rows], reference[rows]
    plain = _misfit(a, b)
    if max(np.median(_turns(a)), np.median(_turns(b))) < MIN_TURN or plain < MIN_MISFIT:
        return ""
    if _misfit(np.roll(a, 1, axis=1), b) < BETTER * plain:
        return "its"
    return "the other's" if _misfit(a, np.roll(b, 1, axis=1)) < BETTER * plain else ""


def _turns(quaternion: FloatArray) -> FloatArray:
    """Angles, rad, between samples half the selection apart."""
    R = se3.matrix_from_quaternion(quaternion)
    far = np.roll(R, len(R) // 2, axis=0)
    return se3.angle(np.swapaxes(far, 1, 2) @ R)


def _misfit(quaternion: FloatArray, reference: FloatArray) -> float:
    return float(np.median(np.abs(_turns(quaternion) - _turns(reference))))
