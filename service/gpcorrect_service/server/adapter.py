"""Gives today's correctors the one answer type; goes when the models themselves answer with `Correction`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gpcorrect.correction import Correction, Reason
from gpcorrect.errors import DataError
from gpcorrect.types import Correction as OldCorrection
from gpcorrect.types import FloatArray

__all__ = ["JointAdapter", "PoseAdapter"]

CODES = {reason.text: int(reason) for reason in Reason if reason}


class PoseAdapter:
    """A `CommandCorrector` whose answers are `Correction`."""

    def __init__(self, corrector: Any) -> None:
        self._corrector = corrector
        self.rigid = corrector.rigid

    def correct(self, pose: FloatArray, twist: FloatArray | None = None) -> Correction:
        """Answer as the protocol says."""
        return _adapted(self._corrector.correct(pose, twist))

    def correct_path(self, poses: FloatArray, times: FloatArray) -> Correction:
        """Answer as the protocol says."""
        old = self._corrector.correct_path(poses, times)
        codes = np.array([_code(text) for text in old.reason], dtype=np.int64)
        return Correction(old.positions, old.quaternions, None, old.std, old.interval95, codes)

    def info(self) -> Mapping[str, Any]:
        """Answer as the protocol says."""
        info: Mapping[str, Any] = self._corrector.info()
        return info

    def stream(self) -> _PoseStreamAdapter:
        """Answer as the protocol says."""
        return _PoseStreamAdapter(self._corrector.stream())


class _PoseStreamAdapter:
    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self.reset = stream.reset

    def correct(self, time: float, pose: FloatArray, twist: FloatArray | None = None) -> Correction:
        """Answer as the protocol says."""
        return _adapted(self._stream.correct(time, pose, twist))


class JointAdapter:
    """A `JointCorrector` whose answers are `Correction`; a path is a stream asked row by row."""

    def __init__(self, corrector: Any) -> None:
        self._corrector = corrector
        self.types: str = corrector.types

    def correct_path(
        self, q: FloatArray, times: FloatArray, efforts: FloatArray | None, sessions: Sequence[int] | None
    ) -> Correction:
        """Answer as the protocol says."""
        stream, answers = self.stream(), []
        for i, time in enumerate(times.tolist()):
            if sessions is not None and i and sessions[i] != sessions[i - 1]:
                stream.reset()
            try:
                answers.append(stream.estimate(time, q[i], None if efforts is None else efforts[i]))
            except DataError as error:
                raise DataError(f"row {i} of the joints: {error.message}", hint=error.hint) from error
        return Correction.stack(answers)

    def stream(self) -> _JointStreamAdapter:
        """Answer as the protocol says."""
        from gpcorrect.joint_corrector import JointStream

        return _JointStreamAdapter(JointStream(self._corrector))

    def info(self) -> Mapping[str, Any]:
        """Answer as the protocol says."""
        corrector = self._corrector
        return {**corrector.summary, "method": corrector.method, "direction": corrector.direction, "types": self.types}


class _JointStreamAdapter:
    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self.reset = stream.reset

    def estimate(self, time: float, q: FloatArray, effort: FloatArray | None = None) -> Correction:
        """Answer as the protocol says."""
        old = self._stream.estimate(time, q, effort)
        reason = Reason.NONE if np.isfinite(old.q).all() else Reason.MISSING
        return Correction(None, None, old.q, old.std, np.full(len(old.q), np.nan), reason)


def _adapted(old: OldCorrection) -> Correction:
    return Correction(old.position, old.quaternion, None, old.std, old.interval95, Reason(_code(old.reason)))


def _code(text: str) -> int:
    return sum(CODES[part] for part in text.split("; ")) if text else 0
