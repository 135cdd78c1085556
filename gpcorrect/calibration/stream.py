"""Answers to a live stream, one sample after the other: velocity, memory and filters follow from those before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect import se3
from gpcorrect.calibration.learners import CableModel
from gpcorrect.calibration.memory import MemoryMap, advance, steps
from gpcorrect.calibration.one_pose import inputs
from gpcorrect.calibration.path_follower import PathFollower
from gpcorrect.calibration.queries import bad_query, pose_numbers, twist_numbers
from gpcorrect.calibration.training_motion import UNITS, SlowStream
from gpcorrect.correction import Correction, Reason
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray, PoseSignal
from gpcorrect.velocity import CausalTwist

if TYPE_CHECKING:
    from gpcorrect.calibration.cartesian import CommandCorrector
    from gpcorrect.calibration.joints import JointCorrector
    from gpcorrect.calibration.tool_position import PositionEstimator

NO_MEMORY = np.zeros(0)


class PoseStream:
    """Answers desired poses one after the other; one stream a planner and thread.

    Memory is of its own answers: they are taken as commanded. Call :meth:`reset` where they were not.

    Parameters
    ----------
    corrector : CommandCorrector
        What answers.
    """

    def __init__(self, corrector: CommandCorrector) -> None:
        self._corrector = corrector
        self._twist = CausalTwist()
        self._slow = SlowStream(corrector.trained)
        self.reset()

    def reset(self) -> None:
        """Forget the past, as after the arm was moved by hand."""
        self._twist.reset()
        self._slow.reset()
        self._last: _Last | None = None
        route, memory = self._corrector.route, self._corrector.memory
        self._joints = None if route is None else route.stream()
        self._q: FloatArray | None = None
        self._state = NO_MEMORY if memory is None else np.zeros(memory.states.radii.shape)

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
            As for `CommandCorrector.correct`, or time does not advance; the past stays.
        """
        corrector = self._corrector
        query = pose_numbers(pose, orientation=corrector.has_orientation)
        given = twist_numbers(twist)
        good, position, rotation, *_ = inputs(query, given, NO_MEMORY, corrector.frame, corrector.region)
        if not good:
            raise bad_query(query, given)
        self._slow.look(time, query[:3])
        turned = se3.matrix_from_quaternion(query[None, 3:])[0] if len(query) > 3 else None
        estimated = self._twist.update(time, query[:3], turned)
        velocity = np.nan_to_num(estimated) if twist is None else given
        reasons = int(Reason.JUST_BEGUN) if twist is None and not np.isfinite(estimated[:3]).all() else 0
        if self._joints is not None and corrector.route is not None:
            route = corrector.route
            q = route.kinematics.inverse_one(position, rotation, self._q)
            in_joints, self._q = self._joints.correct(time, q), q if np.isfinite(q).all() else None
            if self._q is None:
                return corrector.without_joints(corrector.one(query, velocity, reasons))
            return route.as_pose(position, rotation, q, in_joints, corrector.law.bounds.largest).because(
                Reason(reasons)
            )
        if corrector.memory is None:
            return corrector.one(query, velocity, reasons)
        quaternion = se3.quaternion_from_matrix(rotation[None]) if corrector.has_orientation else None
        reference, states = PoseSignal(position[None], quaternion), corrector.memory.states
        answer = corrector.one(query, velocity, reasons, self._remembered(states, reference))
        self._remember(states, reference, answer)
        return answer

    def _remembered(self, states: MemoryMap, reference: PoseSignal) -> FloatArray:
        """Return features of the slacks where the last command left them, moved on by the reference's step."""
        if self._last is None:
            return states.features(self._state)
        step = steps(_joined(self._last.reference, reference))[1]
        return states.features(advance(self._state, step, states.radii))

    def _remember(self, states: MemoryMap, reference: PoseSignal, answer: Correction) -> None:
        """Advance the slacks to what was commanded."""
        assert answer.position is not None
        quaternion = answer.quaternion if self._corrector.has_orientation else None
        command = PoseSignal(answer.position[None], None if quaternion is None else quaternion[None])
        if self._last is not None:
            self._state = advance(self._state, steps(_joined(self._last.command, command))[1], states.radii)
        self._last = _Last(reference, command)


class _Last(NamedTuple):
    """The pose before: reference and command, a row each."""

    reference: PoseSignal
    command: PoseSignal


def _joined(first: PoseSignal, second: PoseSignal) -> PoseSignal:
    quaternions = [pose.quaternion for pose in (first, second) if pose.quaternion is not None]
    return PoseSignal(np.vstack([first.position, second.position]), np.vstack(quaternions) if quaternions else None)


class JointStream:
    """Answers joints sample after sample, as the whole path is answered up to rounding; one stream an arm and thread.

    Parameters
    ----------
    corrector : JointCorrector
        What answers.
    """

    def __init__(self, corrector: JointCorrector) -> None:
        self._corrector = corrector
        self._follower = PathFollower(corrector.view.features, corrector.usual_step, corrector.shortest_step)
        self._slow = SlowStream(corrector.trained)
        self.reset()

    def reset(self) -> None:
        """Forget the past, as after a homing or after the arm was moved by hand."""
        self._follower.reset()
        self._slow.reset()
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
        state : (k,) array, optional
            For models of the whole state.

        Raises
        ------
        DataError
            The numbers do not fit the model, or time does not advance; the past stays.
        """
        view, law = self._corrector.view, self._corrector.law
        joints = _numbers(q, len(view.types), "joints")
        efforts = None if effort is None else _numbers(effort, len(view.types), "efforts")[view.moving]
        rest = None if state is None else _numbers(state, view.features.n_state, "state columns")
        self._corrector.trained.refuse_far(joints, UNITS)
        self._slow.look(time, joints)
        self._follower.arrive(time)
        moving = view.reached(joints)[view.moving]
        if not np.isfinite(moving).all():
            self.reset()
            return view.answer(joints[None], law.unknown())[0]
        new = self._follower.new
        if new and self._filters:
            self.reset()
        x = self._follower.columns(time, moving, efforts, rest)
        if isinstance(law.learned, CableModel):
            mean, std = self._filtered(law.learned, moving, efforts, new)
            rows = np.array([np.isfinite(mean).all()])
            prediction = law.guarded(mean[None] - moving, std[None], np.zeros(1), x[None], rows)
        else:
            prediction = law.predict_one(x, moving if view.end_to_end else np.zeros(len(moving)))
        self._follower.passed(time, moving)
        return view.answer(joints[None], prediction)[0]

    def _filtered(
        self, cable: CableModel, q: FloatArray, effort: FloatArray | None, new: bool
    ) -> tuple[FloatArray, FloatArray]:
        motor, stretch = cable.inputs(q[None], None if effort is None else effort[None])
        samples = zip(self._filters, motor[0].tolist(), stretch[0].tolist(), strict=True)
        mean, std = np.array([one.step(m, s, new) for one, m, s in samples]).T
        return mean, std


@dataclass(frozen=True, eq=False)
class RobotState:
    """One moment of the robot's state, as a stream hands it over.

    Parameters
    ----------
    time : float
        s.
    measured_jp : (d,) array
        Reported joints, rad or m.
    measured_position : (3,) array
        Reported position of the tool, base frame, m.
    measured_quaternion : (4,) array or None
        Reported orientation wxyz.
    setpoint_jp, measured_jv, measured_jf : (d,) arrays or None
        Commanded joints, velocities, efforts.
    setpoint_position, setpoint_quaternion : arrays or None
        Commanded pose.
    extra : sequence of float
        The extra columns that the model was trained with, in its order.
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


class ToolStream:
    """Estimates the tool's position sample after sample, as in a servo loop; well below a millisecond each.

    Parameters
    ----------
    estimator : PositionEstimator
        What was learned.
    """

    def __init__(self, estimator: PositionEstimator) -> None:
        self._estimator = estimator
        self._follower = PathFollower(estimator.view.features, estimator.usual_step, estimator.shortest_step)
        self._slow = SlowStream(estimator.trained)

    def reset(self) -> None:
        """Forget the past, as after the arm was moved by hand."""
        self._follower.reset()
        self._slow.reset()

    def correct(self, state: RobotState) -> Correction:
        """Return the estimated position `(3,)`, base frame, m.

        Parameters
        ----------
        state : RobotState
            One moment, later than the one before.

        Raises
        ------
        DataError
            The sample lacks what the model was trained with, or time does not advance.
        """
        view, law = self._estimator.view, self._estimator.law
        q = _numbers(state.measured_jp, len(view.features.centre), "joints")
        effort = None if state.measured_jf is None else _numbers(state.measured_jf, len(q), "efforts")
        whole = _whole_state(state, view.features.n_state) if "state" in view.features.kinds else None
        self._estimator.trained.refuse_far(q, UNITS)
        self._slow.look(state.time, q)
        self._follower.arrive(state.time)
        x = self._follower.columns(state.time, q, effort, whole)
        if not np.isfinite(x).all():
            raise DataError(
                "the sample lacks a number that the model needs, or holds one that is not finite.",
                hint="Hand over the same signals as in the training log.",
            )
        self._follower.passed(state.time, q)
        prediction = law.predict_one(x, np.zeros(3))
        return view.answer(np.asarray(state.measured_position, dtype=np.float64)[None], prediction)[0]


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
