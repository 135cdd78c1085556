"""Corrections of a live stream of desired poses: velocity and memory come from the poses that went before."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect import se3
from gpcorrect.corrector.answer import NO_MEMORY, Answerer
from gpcorrect.corrector.memory import MemoryMap
from gpcorrect.corrector.one_pose import inputs
from gpcorrect.corrector.queries import bad_query, pose_numbers, twist_numbers
from gpcorrect.play import advance
from gpcorrect.types import Correction, FloatArray, PoseSignal
from gpcorrect.velocity import CausalTwist

__all__ = ["CorrectionStream"]

NOT_MOVING_YET = "the stream has just begun: taken as at rest"


class CorrectionStream:
    """Answers desired poses one after the other; one stream a planner and thread.

    Memory is of its own answers: they are taken as commanded. Call :meth:`reset` where they were not.

    Parameters
    ----------
    answerer : Answerer
        Answers without memory.
    recalling : (Answerer, MemoryMap) or None
        Answers with memory, and the memory; None for a corrector that has none.
    orientation : bool
        Whether orientations are corrected too.
    window : float
        Length of the past that a velocity is estimated from, s.
    """

    def __init__(
        self,
        answerer: Answerer,
        recalling: tuple[Answerer, MemoryMap] | None = None,
        *,
        orientation: bool,
        window: float = 0.1,
    ) -> None:
        self._plain = answerer
        self._answerer = answerer if recalling is None else recalling[0]
        self._memory = None if recalling is None else recalling[1]
        self._orientation = orientation
        self._twist = CausalTwist(window)
        self.reset()

    def reset(self) -> None:
        """Forget the past, as after the arm was moved by hand."""
        self._twist.reset()
        self._last: _Last | None = None
        self._state = NO_MEMORY if self._memory is None else np.zeros(self._memory.radii.shape)

    def correct(self, time: float, pose: ArrayLike, twist: ArrayLike | None = None) -> Correction:
        """Return what to command so that the robot reaches `pose` at `time`.

        Parameters
        ----------
        time : float
            Seconds, later than that of the pose before.
        pose : (7,) or (3,) array
            As for `CommandCorrector.correct`.
        twist : (6,) array, optional
            Desired velocity; estimated from the poses so far when not given.

        Raises
        ------
        DataError
            As for `CommandCorrector.correct`, or time does not advance; the past is kept.
        """
        query = pose_numbers(pose, orientation=self._orientation)
        given = twist_numbers(twist)
        good, position, rotation, *_ = inputs(query, given, NO_MEMORY, self._plain.frame, self._plain.region)
        if not good:
            raise bad_query(query, given)
        estimated = self._twist.update(time, query[:3], _rotation(query))
        velocity = np.nan_to_num(estimated) if twist is None else given
        remark = NOT_MOVING_YET if twist is None and not np.isfinite(estimated[:3]).all() else ""
        if self._memory is None:
            return self._answerer.one(query, velocity, NO_MEMORY, remark)
        reference = PoseSignal(
            position[None], se3.quaternion_from_matrix(rotation[None]) if self._orientation else None
        )
        answer = self._answerer.one(query, velocity, self._recalled(self._memory, reference), remark)
        self._remember(self._memory, reference, answer)
        return answer

    def _recalled(self, memory: MemoryMap, reference: PoseSignal) -> FloatArray:
        """Features of the slacks where the last command left them, moved on by the reference's step."""
        if self._last is None:
            return memory.features(self._state)
        return memory.features(
            advance(self._state, memory.steps(_joined(self._last.reference, reference))[1], memory.radii)
        )

    def _remember(self, memory: MemoryMap, reference: PoseSignal, answer: Correction) -> None:
        """Advance the slacks to what was commanded."""
        quaternion = answer.quaternion if self._orientation else None
        command = PoseSignal(answer.position[None], None if quaternion is None else quaternion[None])
        if self._last is not None:
            self._state = advance(self._state, memory.steps(_joined(self._last.command, command))[1], memory.radii)
        self._last = _Last(reference, command)


class _Last(NamedTuple):
    """The pose before: reference and command, a row each."""

    reference: PoseSignal
    command: PoseSignal


def _joined(first: PoseSignal, second: PoseSignal) -> PoseSignal:
    quaternions = [pose.quaternion for pose in (first, second) if pose.quaternion is not None]
    return PoseSignal(np.vstack([first.position, second.position]), np.vstack(quaternions) if quaternions else None)


def _rotation(query: FloatArray) -> FloatArray | None:
    return se3.matrix_from_quaternion(query[None, 3:])[0] if len(query) > 3 else None
