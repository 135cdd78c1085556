"""Answers to a live stream of joints, one sample after the other: velocity, memory and filters follow from before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect import se3
from gpcorrect.calibration.joint_view import ViewCorrector
from gpcorrect.calibration.law import Prediction
from gpcorrect.calibration.learners import CableModel
from gpcorrect.calibration.path_follower import PathFollower
from gpcorrect.calibration.training_motion import UNITS, SlowStream
from gpcorrect.correction import Correction
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray


class _ViewStream:
    """What the past of a stream of joints says of the next sample; one stream an arm and thread.

    Parameters
    ----------
    corrector : ViewCorrector, what answers
    """

    def __init__(self, corrector: ViewCorrector) -> None:
        self._corrector = corrector
        self._follower = PathFollower(corrector.view.features, corrector.usual_step, corrector.shortest_step)
        self._slow = SlowStream(corrector.trained)
        self.reset()

    def reset(self) -> None:
        """Forget the past, as after a homing or after the arm was moved by hand."""
        self._follower.reset()
        self._slow.reset()

    def _arrive(self, time: float, joints: FloatArray) -> None:
        """Refuse a sample that cannot be of this arm and follow the one before."""
        self._corrector.trained.refuse_far(joints, UNITS)
        self._slow.look(time, joints)
        self._follower.arrive(time)


class JointStream(_ViewStream):
    """Answers joints sample after sample, as the whole path is answered up to rounding; one stream an arm and thread.

    Parameters
    ----------
    corrector : JointCorrector, what answers
    """

    def reset(self) -> None:
        """Forget the past, as after a homing or after the arm was moved by hand."""
        super().reset()
        learned = self._corrector.law.learned
        self._filters = learned.filters() if isinstance(learned, CableModel) else []

    def correct(
        self, time: float, q: ArrayLike, effort: ArrayLike | None = None, state: ArrayLike | None = None
    ) -> Correction:
        """Return corrected joints `(d,)` at `time`.

        Parameters
        ----------
        time : float
            Seconds; later than that of the sample before.
        q : (d,) array
            Reported (or, for commands, desired true) joints, rad or m. With a missing number the answer is NaN, and
            the path begins anew.
        effort : (d,) array, optional
            As logged; the answer is NaN where the model looks at efforts and none are given.
        state : (k,) array, optional, for models of the whole state

        Raises
        ------
        DataError
            The numbers do not fit the model, or time does not advance; the past stays.
        """
        view, law = self._corrector.view, self._corrector.law
        joints = _numbers(q, len(view.types), "joints")
        efforts = None if effort is None else _numbers(effort, len(view.types), "efforts")[view.moving]
        rest = None if state is None else _numbers(state, view.features.n_state, "state columns")
        self._arrive(time, joints)
        moving = view.reached(joints)[view.moving]
        if np.isfinite(moving).all():
            prediction = self._predicted(time, moving, efforts, rest)
        else:
            self.reset()
            prediction = law.unknown()
        answer: Correction = view.answer(joints[None], prediction)[0]
        return answer

    def _predicted(
        self, time: float, moving: FloatArray, effort: FloatArray | None, state: FloatArray | None
    ) -> Prediction:
        law, new = self._corrector.law, self._follower.new
        if new and self._filters:
            self.reset()
        x = self._follower.columns(time, moving, effort, state)
        self._follower.passed(time, moving)
        if not isinstance(law.learned, CableModel):
            return law.predict_one(x, moving if self._corrector.view.end_to_end else np.zeros(len(moving)))
        motor, stretch = law.learned.inputs(moving[None], None if effort is None else effort[None])
        samples = zip(self._filters, motor[0].tolist(), stretch[0].tolist(), strict=True)
        mean, std = np.array([one.step(m, s, new) for one, m, s in samples]).T
        return law.guarded(mean[None] - moving, std[None], np.zeros(1), x[None], np.array([np.isfinite(mean).all()]))


@dataclass(frozen=True, eq=False)
class RobotState:
    """One moment of the robot's state, as a stream hands it over.

    Parameters
    ----------
    time : float, s
    measured_jp : (d,) array, reported joints, rad or m
    measured_position : (3,) array, reported position of the tool, base frame, m
    measured_quaternion : (4,) array or None, reported orientation wxyz
    setpoint_jp, measured_jv, measured_jf : (d,) arrays or None, commanded joints, velocities, efforts
    setpoint_position, setpoint_quaternion : arrays or None, commanded pose
    extra : sequence of float, the extra columns that the model was trained with, in its order
    """

    time: float
    measured_jp: FloatArray
    measured_position: FloatArray
    measured_quaternion: FloatArray | None = None
    setpoint_jp: FloatArray | None = None
    measured_jv: FloatArray | None = None
    measured_jf: FloatArray | None = None
    setpoint_position: FloatArray | None = None
    setpoint_quaternion: FloatArray | None = None
    extra: Sequence[float] = ()


class ToolStream(_ViewStream):
    """Estimates the tool's position sample after sample, as in a servo loop; well below a millisecond each.

    Parameters
    ----------
    corrector : PositionEstimator, what answers
    """

    def correct(self, state: RobotState) -> Correction:
        """Return the estimated position `(3,)`, base frame, m.

        Parameters
        ----------
        state : RobotState, one moment, later than the one before

        Raises
        ------
        DataError
            The sample lacks what the model was trained with, or time does not advance.
        """
        view, law = self._corrector.view, self._corrector.law
        q = _numbers(state.measured_jp, len(view.features.centre), "joints")
        effort = None if state.measured_jf is None else _numbers(state.measured_jf, len(q), "efforts")
        whole = _whole_state(state, view.features.n_state) if "state" in view.features.kinds else None
        self._arrive(state.time, q)
        x = self._follower.columns(state.time, q, effort, whole)
        if not np.isfinite(x).all():
            raise DataError(
                "the sample lacks a number that the model needs, or holds one that is not finite.",
                hint="Hand over the same signals as in the training log.",
            )
        self._follower.passed(state.time, q)
        prediction = law.predict_one(x, np.zeros(3))
        answer: Correction = view.answer(np.asarray(state.measured_position, dtype=np.float64)[None], prediction)[0]
        return answer


def _whole_state(state: RobotState, expected: int) -> FloatArray:
    """Return the whole state of one sample, in the order of `state_columns`."""
    signals = (state.setpoint_jp, state.measured_jp, state.measured_jv, state.measured_jf)
    parts: list[FloatArray] = [part for part in signals if part is not None]
    if state.setpoint_jp is not None:
        parts.append(np.asarray(state.setpoint_jp) - state.measured_jp)
    for position, quaternion in (
        (state.setpoint_position, state.setpoint_quaternion),
        (state.measured_position, state.measured_quaternion),
    ):
        if position is not None:
            parts.append(position)
            parts += [] if quaternion is None else [se3.matrix_from_quaternion(quaternion).ravel()]
    return _numbers(np.concatenate([*parts, np.asarray(state.extra, dtype=np.float64)]), expected, "numbers of state")


def _numbers(values: ArrayLike, size: int, what: str) -> FloatArray:
    numbers = np.array(values, dtype=np.float64)
    if numbers.shape != (size,):
        raise DataError(f"the model takes {size} {what}, got shape {numbers.shape}.")
    return numbers
