"""Checks of orientations: norm, sign, direction of turning."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gpcorrect import se3
from gpcorrect.logs.checks.evidence import Evidence
from gpcorrect.logs.checks.finding import Finding, Severity, examples
from gpcorrect.logs.checks.measure import mirrored
from gpcorrect.types import BoolArray, FloatArray

__all__ = ["Inverted", "QuaternionNorm", "QuaternionSign"]

NORM_TOLERANCE = 1e-3  # the log format calls a sample bad beyond it
MANY_BAD = 0.01  # of the samples
MIN_TURN = np.deg2rad(5.0)  # an orientation that varies less may be all noise
COMPARED = 2000  # poses; more say nothing new


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
    """A quaternion and its negative are one rotation: jumps between them are harmless, but not everywhere."""

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield how often the sign flips."""
        for name, quaternion in _with_quaternions(evidence):
            flips = np.zeros(len(quaternion), dtype=np.bool_)
            for _, rows in evidence.log.trajectories():
                flips[rows[1:]] = np.einsum("ij,ij->i", quaternion[rows[1:]], quaternion[rows[:-1]]) < 0
            rows = np.flatnonzero(flips)
            if rows.size:
                what = f"the sign of the quaternion flips {rows.size} times; as rotations these are no jumps."
                yield Finding("info", "quaternion_sign", name, what, "", int(rows.size), examples(rows))


@dataclass(frozen=True)
class Inverted:
    """Two records of one rotation turn the same way.

    Seen from one sample, the rotation vectors of all others differ between two frames by a rotation. Those of
    inverse rotations differ by a reflection as well; so do those of quaternions whose components were read in
    cyclic order (xyzw for wxyz), for that is a reflection of the four numbers.
    """

    def findings(self, evidence: Evidence) -> Iterator[Finding]:
        """Yield a finding where one record turns the other way."""
        signals = {n: q for n, q in _with_quaternions(evidence) if evidence.has(n)}
        reference = next((n for n in ("setpoint_cp", "measured_cp") if n in signals), None)
        for name in ("tracker_cp", "measured_cp"):
            if reference is None or name not in signals or name == reference:
                continue
            if _inverted(signals[reference], signals[name]):
                what = f"it turns the other way than {reference}."
                hint = "Are the quaternions xyzw, not wxyz? Or the poses of the frame seen by the tool?"
                yield Finding("error", "orientation_inverted", name, what, hint, len(evidence.log))


def _inverted(reference: FloatArray, observed: FloatArray) -> bool:
    rows = np.flatnonzero(_usable(reference) & _usable(observed))
    if rows.size < 2:
        return False
    rows = rows[np.linspace(0, rows.size - 1, min(rows.size, COMPARED)).astype(int)]
    R, S = se3.matrix_from_quaternion(reference[rows]), se3.matrix_from_quaternion(observed[rows])
    middle = int(np.argmin(se3.angle(se3.rotation_mean(R).T @ R)))
    turn, seen = (se3.rotvec_from_matrix(X[middle].T @ X) for X in (R, S))
    return bool(np.median(np.linalg.norm(turn, axis=1)) > MIN_TURN) and mirrored(turn, seen)


def _usable(quaternion: FloatArray) -> BoolArray:
    norm = np.linalg.norm(quaternion, axis=1)
    usable: BoolArray = (norm > 0.5) & (norm < 2.0)
    return usable
