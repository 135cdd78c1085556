"""How joint calibration sees a log: which joints go in, what is to come out, and answers from predictions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from gpcorrect.calibration.dataset import Layout, Samples
from gpcorrect.calibration.joint_features import JointFeatures, law_penalties
from gpcorrect.calibration.joint_path import (
    JointPath,
    joint_path,
    logged_path,
    refuse_other_columns,
    without_faults,
)
from gpcorrect.calibration.law import Prediction
from gpcorrect.calibration.leaps import Apart, Pace
from gpcorrect.calibration.memory import spans
from gpcorrect.calibration.settings import Direction, InputSignal
from gpcorrect.calibration.stops import Stops
from gpcorrect.calibration.task import Corrector, Measured
from gpcorrect.correction import Correction, Reason
from gpcorrect.errors import DataError, LogError
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, frozen_array

MOST_PRISMATIC, MOST_REVOLUTE = 2.0, 20.0
"""m and rad: no arm inserts 2 m, and 20 rad are over three turns, so such numbers are in millimetres or degrees."""
STILL = {"R": 2e-3, "P": 2e-4}
"""rad and m that a joint that was still in training may stand from there before nothing is known: a servo's wobble,
through which joints that pull on each other, as strongly as any that were recorded, move by less than they are missed.
Within 50 mm, taken for 0.05 rad, an outsider's roll joint was off by 3 degrees, in domain."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PathView(ABC):
    """What goes in of a log, as features of a joint path, and what is to come out."""

    features: JointFeatures  # what the law looks at

    @abstractmethod
    def of_log(self, log: CalibrationLog, keep: BoolArray, *, needs_truth: bool = True) -> tuple[FloatArray, Samples]:
        """Return what is to be corrected `(n, d)`, and the samples of a log.

        Parameters
        ----------
        log : CalibrationLog, n samples
        keep : (n,) mask, samples that are not rejected
        needs_truth : bool, whether what is to come out must be logged
        """

    @abstractmethod
    def answer(self, given: FloatArray, prediction: Prediction) -> Correction:
        """Return what was given `(n, d)`, corrected by the predictions of a law.

        Parameters
        ----------
        given : (n, d) array, joints (rad or m) or positions (m)
        prediction : Prediction, of the same samples
        """

    def samples(self, path: JointPath, trajectory: IntArray, error: FloatArray, keep: BoolArray) -> Samples:
        """Return the samples of a path.

        Parameters
        ----------
        path : JointPath, n samples of the joints
        trajectory : (n,) int array, as in the log
        error : (n, m) array, what is to be added to what is given, rad or m; NaN where unknown
        keep : (n,) mask, samples that may be learned from where they are complete
        """
        X = self.features.transform(path)
        usable = keep & np.isfinite(X).all(axis=1) & np.isfinite(error).all(axis=1)
        unsure = self.features.unsure(spans(self.features.scaled(path.q), path.new))
        return Samples(path.time, trajectory, path.new, X, error, np.zeros(error.shape), usable, unsure=unsure)


@dataclass(frozen=True, eq=False, kw_only=True)
class JointView(PathView):
    """Which of a log's joints go in, and what is to come out; features are of the k joints that moved in training."""

    direction: Direction
    input_signal: InputSignal  # signal of the robot's side
    types: str  # "R" or "P" for each of the d joints
    moving: IntArray  # (k,) joints that moved in training; only these are corrected
    rest: FloatArray  # (d,) where each joint stood in the middle of training, rad or m
    end_to_end: bool  # whether the law predicts the positions themselves, not their error
    # where joints end, whatever is wrong with them besides; None where training showed no stop
    stops: Stops | None = None
    # columns of the whole state; empty for a law that does not look at it, and in models of before
    state_names: tuple[str, ...] = ()
    # (s,) by how much joints that stood in training were missed there at most, rad or m; unknown in models of before
    missed: FloatArray = field(default_factory=lambda: np.zeros(0))
    # (s,) joints that stood in training, and how far from there they may be, rad or m: a stream asks at 1 kHz
    still: IntArray = field(init=False, repr=False)
    still_within: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "moving", frozen_array(self.moving, np.int64))
        object.__setattr__(self, "rest", frozen_array(self.rest))
        if self.moving.tolist() != sorted(set(self.moving.tolist()) & set(range(len(self.types)))):
            raise DataError(f"joints {self.moving} are to be corrected, which are not {len(self.types)} in order.")
        if self.rest.shape != (len(self.types),):
            raise DataError(f"a model of {len(self.types)} joints rests in {self.rest.shape}.")
        if self.stops is not None and len(self.stops.low) != len(self.types):
            raise DataError(f"a model of {len(self.types)} joints has stops of {len(self.stops.low)}.")
        still = np.setdiff1d(np.arange(len(self.types)), self.moving)
        if self.missed.size not in (0, still.size):
            raise DataError(f"{still.size} joints that stood were missed by {self.missed.size} numbers.")
        object.__setattr__(self, "still", still)
        object.__setattr__(self, "still_within", np.array([STILL[self.types[j]] for j in still]))

    def reached(self, q: FloatArray) -> FloatArray:
        """Return joints `(..., d)` taken back to their stops: what the law sees of those that go in.

        Parameters
        ----------
        q : (..., d) array, rad or m
        """
        return q if self.stops is None else self.stops.reached(q)

    def of_log(self, log: CalibrationLog, keep: BoolArray, *, needs_truth: bool = True) -> tuple[FloatArray, Samples]:
        """See :class:`PathView`."""
        source, truth = directed(log, self.input_signal, self.direction, needs_truth=needs_truth)
        if source.shape[1] != len(self.types):
            raise DataError(f"the model knows {len(self.types)} joints, the log has {source.shape[1]}.")
        kinds = self.features.kinds
        path, error = path_and_error(log, source, truth, keep, self.stops, self.moving, self.direction, kinds)
        if self.state_names:
            refuse_other_columns(path.state_names, self.state_names)
        return source, self.samples(path, log.trajectory, error, keep)

    def samples(self, path: JointPath, trajectory: IntArray, error: FloatArray, keep: BoolArray) -> Samples:
        """See :class:`PathView`; of the moving joints, which learners that filter a path may follow."""
        samples = super().samples(path, trajectory, error, keep)
        origin = path.q if self.end_to_end else samples.origin
        return replace(samples, target=error + origin, origin=origin, path=path.q, effort=path.effort)

    def answer(self, given: FloatArray, prediction: Prediction) -> Correction:
        """See :class:`PathView`; joints that were still in training stay as they are."""
        joints = np.array(self.reached(given))
        joints[:, self.moving] += prediction.residual
        missing = np.asarray(~np.isfinite(joints).all(axis=1))
        joints[missing] = np.nan
        away = np.abs(given[:, self.still] - self.rest[self.still])
        strayed = np.asarray((away > self.still_within).any(axis=1))
        if self.direction == "command":  # beyond a stop nothing is reached, whatever is commanded
            strayed |= ((self.reached(given) != given) | (self.reached(joints) != joints)).any(axis=1)
        std, interval95 = self.wide(prediction.std), self.wide(prediction.interval95)
        if self.missed.size:
            interval95[:, self.still] = np.where((strayed | missing)[:, None], np.nan, self.missed)
        answer = Correction(None, None, joints, std, interval95, prediction.reasons)
        return answer.because(Reason.OUTSIDE, strayed).because(Reason.MISSING, missing)

    def wide(self, values: FloatArray) -> FloatArray:
        """Return values `(n, k)` of the moving joints among those of all `(n, d)`, NaN for those that were still.

        Parameters
        ----------
        values : (n, k) array, of the moving joints
        """
        if len(self.moving) == len(self.types):
            return values
        wide = np.full((len(values), len(self.types)), np.nan)
        wide[:, self.moving] = values
        return wide


@dataclass(frozen=True, eq=False, kw_only=True)
class ViewCorrector(Corrector):
    """A corrector whose samples and answers a view of the log makes, of features of a joint path."""

    CHECK_SAMPLES: ClassVar[int]
    """Along the swing that a model file is checked with."""

    view: PathView
    # time between samples in training, s: what a pause is, and over what a velocity is taken
    usual_step: float
    shortest_step: float

    @property
    def pace(self) -> Pace:
        """How far the arm can get from one sample to the next."""
        return Pace(self.trained, self.usual_step)

    def correct_log(self, log: CalibrationLog) -> Correction:
        """Return the answers to a recorded path, n rows.

        Parameters
        ----------
        log : CalibrationLog, n samples; needs no truth

        Raises
        ------
        LogError, DataError
            A signal is missing or cannot be right, or the log has other joints or state than the training's.
        """
        log = self.in_joint_order(log)
        self.refuse_misread(log)
        log, apart = self._apart(log)
        reported, samples = self.view.of_log(log, np.ones(len(log), dtype=bool), needs_truth=False)
        answer = self.view.answer(reported, self.predicted(samples, apart))
        return answer if apart is None else answer[apart.back]

    def samples(self, log: CalibrationLog, keep: BoolArray) -> Samples:
        """See :class:`Corrector`."""
        return self.view.of_log(log, keep)[1]

    def measure(self, log: CalibrationLog, keep: BoolArray) -> Measured:
        """See :class:`Corrector`."""
        log, apart = self._apart(log)
        order = np.arange(len(log)) if apart is None else apart.order
        given, samples = self.view.of_log(log, keep[order])
        prediction = self.predicted(samples, apart)
        answer = self.view.answer(given, prediction)
        rows = np.flatnonzero(samples.usable & np.isfinite(prediction.residual).all(axis=1))
        if rows.size == 0:
            raise LogError("no sample has both positions and their truth.", path=log.name)
        raw, registered, corrected = self._errors(log, given, samples, prediction)
        speed = np.full(len(log), np.nan)
        return Measured(
            raw, registered, corrected, answer.interval95, answer.in_domain, speed, order, log.time, log.trajectory
        ).at(rows[np.argsort(order[rows])])

    def predicted(self, samples: Samples, apart: Apart | None) -> Prediction:
        """Return what the law says of samples; of leaps, as of paths of their own, outside.

        Parameters
        ----------
        samples : Samples, n samples
        apart : Apart or None, how leaps were put behind the others
        """
        prediction = self.law.predict(samples)
        return prediction if apart is None else self.law.outside(prediction, apart.leap)

    def _apart(self, log: CalibrationLog) -> tuple[CalibrationLog, Apart | None]:
        """Return a log with its leaps behind all other samples, and how; as it is where it has none."""
        apart = None if log.static else Apart.of(self.pace, self.query_path(log), log.time, log.session)
        return (log, None) if apart is None else (replace(log.select(apart.order), session=apart.session), apart)

    @abstractmethod
    def _errors(
        self, log: CalibrationLog, given: FloatArray, samples: Samples, prediction: Prediction
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the errors `(n, m)` of the three methods that are measured."""

    def check_answers(self) -> FloatArray:
        """See :class:`Corrector`: along a short swing through the middle of the training range, all else at zero."""
        n, features = self.CHECK_SAMPLES, self.view.features
        q = features.centre + np.sin(np.linspace(0.0, 2.0 * np.pi, n))[:, None] * features.half
        state = np.zeros((n, features.n_state)) if features.n_state else None
        one, unknown = np.zeros(n, dtype=np.int64), np.full((n, len(self.law.zero)), np.nan)
        path = joint_path(np.arange(n, dtype=np.float64), one, q, np.zeros(q.shape), state)
        # From the middle of the slack, as files of before there was a doubt about it were checked.
        samples = replace(self.view.samples(path, one, unknown, np.zeros(n, dtype=bool)), unsure=None)
        prediction = self.law.predict(samples)
        return np.nan_to_num(np.hstack([prediction.residual, prediction.std]))


def joint_layout(features: JointFeatures, targets: int, *, owned: bool, inducing: int) -> Layout:
    """Return how joint features and targets are grouped: a linear law, then a field on the smooth features.

    Parameters
    ----------
    features : JointFeatures, with their columns
    targets : int, m
    owned : bool, whether each target is the error of the joint of its number; each is then bounded by itself
    inducing : int, points of the Gaussian process
    """
    return Layout(
        targets=(1,) * targets if owned else (targets,),
        inputs=None,
        smooth=features.smooth,
        penalties=law_penalties(features, targets, owned),
        slack=np.zeros(len(features.used)),
        inducing=inducing,
        fading=np.flatnonzero(np.isin(features.origins[0], ("velocity", "acceleration"))),
        place=np.flatnonzero(features.origins[0] == "position"),
        present=np.flatnonzero(np.isin(features.origins[0], ("position", "effort", "state"))),
        efforts=np.flatnonzero(features.origins[0] == "effort"),
        velocities=np.flatnonzero(features.origins[0] == "velocity"),
    )


def directed(
    log: CalibrationLog, signal: InputSignal, direction: str, *, needs_truth: bool = True
) -> tuple[FloatArray, FloatArray | None]:
    """Return the joints that go in and those that are to come out, `(n, d)`.

    Parameters
    ----------
    log : CalibrationLog, n samples
    signal : str, signal of the robot's side
    direction : str, "estimate" or "command"
    needs_truth : bool, whether what is to come out must be logged
    """
    given, wanted = (signal, "external_jp") if direction == "estimate" else ("external_jp", signal)
    source = _joint_signal(log, given)
    checked = needs_truth or (direction == "estimate" and log.external_jp is not None)
    truth = _joint_signal(log, wanted) if checked else getattr(log, wanted)
    if truth is not None and truth.shape != source.shape:
        raise LogError(
            f"{given} has {source.shape[1]} joints, {wanted} {truth.shape[1]}.",
            hint="Name the same joints in both: a mapping file given with --columns says which columns are which.",
            path=log.name,
        )
    return source, truth


def _joint_signal(log: CalibrationLog, name: str) -> FloatArray:
    """Return a joint signal `(n, d)` of a log, its units checked."""
    values: FloatArray | None = getattr(log, name)
    if values is None:
        of_tracker = name == "external_jp" and log.tracker_cp is not None
        raise LogError(
            f"joint calibration needs {name}; the log has {', '.join(log.signals) or 'no signals'}.",
            hint="Map its columns: --columns map.toml"
            + (", or name the arm that the tracker saw: --machine robot.urdf" if of_tracker else "")
            + "".join(f". Reading said: {remark.rstrip('.')}" for remark in log.remarks),
            path=log.name,
        )
    for joint, kind in enumerate(log.joint_types(values.shape[1])):
        most, unit, other = (MOST_PRISMATIC, "m", "mm") if kind == "P" else (MOST_REVOLUTE, "rad", "degrees")
        known = np.abs(values[np.isfinite(values[:, joint]), joint])
        if known.size and np.median(known) > most:
            raise LogError(
                f"joint {joint + 1} of {name} is typically {np.median(known):.4g}, too much for {unit}: is it in"
                f" {other}?",
                hint="Logs hold rad and m; give scale in a mapping file, or joint_types in the sidecar.",
                path=log.name,
            )
    return values


def path_and_error(
    log: CalibrationLog,
    source: FloatArray,
    truth: FloatArray | None,
    keep: BoolArray,
    stops: Stops | None,
    moving: IntArray,
    direction: str,
    kinds: Sequence[str],
) -> tuple[JointPath, FloatArray]:
    """Return the path of k moving joints, back at their stops, and what is to be added to them `(n, k)`.

    Parameters
    ----------
    log : CalibrationLog, n samples
    source, truth : (n, d) arrays, joints that go in, and what is to come out, rad or m; None where it is not known
    keep : (n,) mask, samples that are not rejected: faults of an outside sensor do not belong to the path it saw
    stops : Stops or None, where joints end
    moving : (k,) int array, joints that moved in training
    direction : str, "estimate" or "command"; commands are taken back to their stops too
    kinds : sequence of str, kinds of features; the whole state is read for "state" only
    """
    truth = np.full(source.shape, np.nan) if truth is None else truth
    if stops is not None:
        source = stops.reached(source)
        truth = truth if direction == "estimate" else stops.reached(truth)
    seen = source if direction == "estimate" else without_faults(log, source, truth, keep)
    path = logged_path(log, seen, kinds, moving, efforts=direction == "estimate")
    return path, (truth - source)[:, moving]
