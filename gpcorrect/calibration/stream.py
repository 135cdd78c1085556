"""Answers to a live stream of joints, one sample after the other: velocity, memory and filters follow from before."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect import se3
from gpcorrect.calibration.joint_path import JOINT_SIGNALS, refuse_other_columns
from gpcorrect.calibration.joint_view import ViewCorrector
from gpcorrect.calibration.law import Prediction
from gpcorrect.calibration.leaps import Follower, Step
from gpcorrect.calibration.learners import CableModel
from gpcorrect.calibration.learners.ukf import follow
from gpcorrect.calibration.memory import advance, lag_step
from gpcorrect.calibration.queries import numbers
from gpcorrect.calibration.settings import LIMITS
from gpcorrect.calibration.training_motion import UNITS, StreamGuard
from gpcorrect.correction import Correction
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

if TYPE_CHECKING:
    from gpcorrect.calibration.joints import JointCorrector
    from gpcorrect.calibration.tool_position import PositionEstimator

ALMOST = 0.9
"""Of the training's shortest step, over which a faster stream takes its velocities: clocks jitter; chosen by hand."""
MOST_PAST = 4096  # samples stored to take a velocity over: bounds the memory of a stream; chosen by hand


class _Sample(NamedTuple):
    """One moment of the d joints that move."""

    time: float  # s
    q: FloatArray  # (d,) rad or m
    effort: FloatArray | None  # (d,)
    state: FloatArray | None  # (k,)
    along: FloatArray  # (d,) the path whose velocities count: `q`, unless another is given


class _ViewStream:
    """Features of a stream of joints, each sample's from those before: as :meth:`JointFeatures.transform` of the path.

    A stream that is faster than the training takes velocities over the training's step, not over its own: there
    an encoder's last digit would show as motion.
    """

    def __init__(self, corrector: ViewCorrector) -> None:
        self._corrector, self._features = corrector, corrector.view.features
        self._window = ALMOST * corrector.shortest_step
        self._guard, self._follower = StreamGuard(corrector.trained, UNITS), Follower(corrector.pace)
        self.reset()

    def reset(self) -> None:
        """Forget the past, as after a homing or after the arm was moved by hand."""
        self._guard.reset()
        self._follower.reset()
        self._begin()

    def _begin(self) -> None:
        """Forget the path, but not the clock."""
        self._past: deque[tuple[float, FloatArray]] = deque(maxlen=MOST_PAST)
        self._memory: tuple[FloatArray, FloatArray, FloatArray] | None = None  # path, joints and plays so far
        self._ends: tuple[FloatArray, FloatArray] | None = None  # of what the path has covered
        self._settled = False  # whether it has crossed every slack
        self._followed: dict[str, tuple[FloatArray, FloatArray]] = {}  # signals where last known, and lags behind them

    def _arrive(self, time: float, joints: FloatArray) -> bool:
        """Refuse a sample that cannot be of this arm and follow the one before; return whether it is a leap.

        The path is forgotten after a pause, and where the arm is at the place of a leap after all.
        """
        self._guard.admit(time, joints)
        step = self._follower.step(time, joints)
        if step is Step.ANEW or (self._past and time - self._past[-1][0] > self._corrector.pace.pause):
            self._begin()
        return step is Step.LEAP

    def _predict(self, sample: _Sample, leap: bool) -> Prediction:
        """Return what the law says of a sample; of a leap, as of the only sample of a path, outside."""
        if not leap:
            return self._next(sample)
        return self._corrector.law.outside(type(self)(self._corrector)._next(sample))

    def _next(self, sample: _Sample) -> Prediction:
        """Return what the law says of the path's next sample."""
        law = self._corrector.law
        x, unsure = self._inputs(sample)
        return law.predict_rows(x[None], unsure=None if unsure is None else unsure[None])

    def _inputs(self, sample: _Sample) -> tuple[FloatArray, FloatArray | None]:
        """Note where the joints are; return their features `(k,)` and by how much these may be off.

        Features are NaN where the law needs what is not given; for the doubt see :meth:`JointFeatures.unsure`.
        """
        features = self._features
        x = np.concatenate([self._column(kind, sample) for kind in features.kinds])[features.used]
        self._past.append((sample.time, sample.along))
        return x, None if self._settled else self._unsure(features.scaled(sample.q))

    def _unsure(self, scaled: FloatArray) -> FloatArray | None:
        """Note what the path has covered; what it has crossed once it has crossed for good."""
        low, high = self._ends or (scaled, scaled)
        self._ends = np.minimum(low, scaled), np.maximum(high, scaled)
        unsure = self._features.unsure(self._ends[1] - self._ends[0])
        self._settled = unsure is None or not unsure.any()
        return unsure

    def _column(self, kind: str, sample: _Sample) -> FloatArray:
        features = self._features
        match kind:
            case "position":
                return features.scaled(sample.q)
            case "velocity":
                return self._velocity(sample) / features.half
            case "acceleration":
                changes = self._behind(kind, sample.time, self._velocity(sample) / features.half, features.rates)
                return (changes / features.rates[:, None]).ravel()
            case "memory":
                return self._remember(features.scaled(sample.q))
            case "lags":
                signals = features.lagged_signals(features.scaled(sample.q), sample.effort)
                return self._behind(kind, sample.time, signals, features.lags).ravel()
        given = sample.effort if kind == "effort" else sample.state
        size = len(features.centre) if kind == "effort" else features.n_state
        return np.full(size, np.nan) if given is None else given

    def _velocity(self, sample: _Sample) -> FloatArray:
        """Over the latest sample that is about a training step old; until there is one, over the first."""
        if not self._past:
            return np.zeros(len(sample.q))
        while len(self._past) > 1 and sample.time - self._past[1][0] > self._window:
            self._past.popleft()
        then, before = self._past[0]
        return (sample.along - before) / (sample.time - then)

    def _remember(self, path: FloatArray) -> FloatArray:
        """Advance the slacks to `path` (d,), in units of half the ranges, and return their features."""
        features = self._features
        assert features.play is not None
        if self._memory is None:
            joints, lags = path, np.zeros(features.ladder.shape)
        else:
            before, joints, lags = self._memory
            joints, lags = features.play.advance(joints, path), advance(lags, path - before, features.ladder)
        self._memory = path, joints, lags
        return np.concatenate([path - joints, (lags / features.ladder).ravel()])

    def _behind(self, kind: str, time: float, signals: FloatArray, constants: FloatArray) -> FloatArray:
        """Return by how much lags `(t, s)` are behind their signals `(s,)` now."""
        if kind not in self._followed:
            self._followed[kind] = signals, np.zeros((len(constants), len(signals)))
        else:
            last, behind = self._followed[kind]
            behind = lag_step(behind, signals - last, time - self._past[-1][0], constants)
            self._followed[kind] = np.where(np.isfinite(signals), signals, last), behind
        return self._followed[kind][1]


class JointStream(_ViewStream):
    """Answers joints sample after sample, as the whole path is answered up to rounding; one stream an arm and thread.

    Parameters
    ----------
    corrector : JointCorrector, what answers
    """

    _corrector: JointCorrector

    def _begin(self) -> None:
        super()._begin()
        learned = self._corrector.law.learned
        self._cable = np.zeros((2, len(learned.gap) if isinstance(learned, CableModel) else 0))

    def correct(
        self,
        time: float,
        q: ArrayLike,
        effort: ArrayLike | None = None,
        state: ArrayLike | None = None,
        *,
        along: FloatArray | None = None,
    ) -> Correction:
        """Return corrected joints `(d,)` at `time`.

        Parameters
        ----------
        time : float, seconds; later than that of the sample before
        q : (d,) array
            Reported (or, for commands, desired true) joints, rad or m. With a missing number the answer is NaN, and
            the path begins anew.
        effort : (d,) array, optional, as logged; the answer is NaN where the model looks at efforts and none are given
        state : (k,) array, optional, for models of the whole state
        along : (d,) array, optional, as for :meth:`JointCorrector.correct_path`

        Raises
        ------
        DataError
            The numbers do not fit the model, or time does not advance; the past stays.
        """
        joints, sample, leap = self._arrived(time, q, effort, state, along)
        prediction = self._corrector.law.unknown() if sample is None else self._predict(sample, leap)
        return self._corrector.view.answer(joints[None], prediction)[0]

    def follow(
        self, time: float, q: ArrayLike, effort: ArrayLike | None = None, state: ArrayLike | None = None
    ) -> None:
        """Take note of a sample that nobody needs the answer of: those behind it are answered as after `correct`.

        Parameters and errors are those of :meth:`correct`, of whose work this is a third.
        """
        _, sample, leap = self._arrived(time, q, effort, state, None)
        if sample is not None and not leap:
            filters = isinstance(self._corrector.law.learned, CableModel)
            (self._next if filters else self._inputs)(sample)

    def _arrived(
        self, time: float, q: ArrayLike, effort: ArrayLike | None, state: ArrayLike | None, along: FloatArray | None
    ) -> tuple[FloatArray, _Sample | None, bool]:
        """Return the joints (d,), those that move as a sample, and whether it is a leap; a DataError for other numbers.

        There is no sample where a number of these is missing: the path begins anew.
        """
        view = self._corrector.view
        joints = _numbers(q, len(view.types), "joints")
        efforts = None if effort is None else _numbers(effort, len(view.types), "efforts")[view.moving]
        rest = None if state is None else _numbers(state, view.features.n_state, "state columns")
        leap, moving = self._arrive(time, joints), view.reached(joints)[view.moving]
        if not np.isfinite(moving).all():
            self._begin()
            return joints, None, leap
        return joints, _Sample(time, moving, efforts, rest, moving if along is None else along[view.moving]), leap

    def _next(self, sample: _Sample) -> Prediction:
        """See :class:`_ViewStream`; a learner that filters the path follows it."""
        law, new, q, effort = self._corrector.law, not self._past, sample.q, sample.effort
        x, unsure = self._inputs(sample)
        if not isinstance(law.learned, CableModel):
            origin = q[None] if self._corrector.view.end_to_end else 0.0
            return law.predict_rows(x[None], origin, None if unsure is None else unsure[None])
        motor, stretch = law.learned.inputs(q[None], None if effort is None else effort[None])
        mean, std = follow(self._cable, motor[0], stretch[0], new, law.learned.noises)
        std, known = np.hypot(std, law.learned.shown.std), np.array([np.isfinite(mean).all()])
        return law.guarded(mean[None] - q, std[None], np.zeros(1), x[None], known)


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

    _corrector: PositionEstimator

    def correct(self, state: RobotState) -> Correction:
        """Return the estimated position `(3,)`, base frame, m.

        Parameters
        ----------
        state : RobotState, one moment, later than the one before

        Raises
        ------
        DataError
            The sample lacks what the model was trained with, or is in other units, or time does not advance; the past
            stays.
        """
        view = self._corrector.view
        q = _numbers(state.measured_jp, len(view.features.centre), "joints")
        effort = None if state.measured_jf is None else _numbers(state.measured_jf, len(q), "efforts")
        whole = _whole_state(state, view.state_names) if "state" in view.features.kinds else None
        position = _numbers(state.measured_position, 3, "positions")
        if not (np.abs(position) <= LIMITS.far_away).all():
            raise DataError(
                f"the tool is reported at {position}, and no arm reaches so far.", hint="Hand over positions in metres."
            )
        kinds, unknown = view.features.kinds, np.full(len(q), np.nan)
        needed = [q, *([unknown if effort is None else effort] if "effort" in kinds else [])]
        if not np.isfinite(np.concatenate(needed if whole is None else [*needed, whole])).all():
            raise DataError(
                "the sample lacks a number that the model needs, or holds one that is not finite.",
                hint="Hand over the same signals as in the training log.",
            )
        leap = self._arrive(state.time, q)
        return view.answer(position[None], self._predict(_Sample(state.time, q, effort, whole, q), leap))[0]


def _whole_state(state: RobotState, expected: Sequence[str]) -> FloatArray:
    """Return the whole state of one sample as `state_columns` has it, refused where its columns are not as expected."""
    parts: list[tuple[str, ArrayLike | None]] = [(name, getattr(state, name)) for name in JOINT_SIGNALS]
    if state.setpoint_jp is not None:
        parts.append(("joint_lag", np.asarray(state.setpoint_jp) - state.measured_jp))
    for name, position, quaternion in (
        ("setpoint_cp", state.setpoint_position, state.setpoint_quaternion),
        ("measured_cp", state.measured_position, state.measured_quaternion),
    ):
        turn = np.empty(0) if quaternion is None else se3.matrix_from_quaternion(quaternion).ravel()
        parts.append((name, None if position is None else np.concatenate([position, turn])))
    columns = [(name, np.ravel(values)) for name, values in parts if values is not None]
    names = [f"{name}_{i + 1}" for name, values in columns for i in range(len(values))]
    refuse_other_columns([*names, *expected[len(expected) - len(state.extra) :]], expected)
    return np.concatenate([*(values for _, values in columns), np.asarray(state.extra)]).astype(np.float64)


def _numbers(values: ArrayLike, size: int, what: str) -> FloatArray:
    found = numbers(values, what)
    if found.shape != (size,):
        raise DataError(f"the model takes {size} {what}, got shape {found.shape}.")
    return found
