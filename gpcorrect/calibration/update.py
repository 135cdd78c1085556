"""New observations into a fitted model, without its old data and without growing.

Points and hyperparameters stay; the sums over samples (:class:`gpcorrect.gpr.Statistics`) of old and new data are
added, the old ones weighted by what predicts left-out new trajectories best, so that a robot that changed is followed
and one that did not loses nothing. A linear law before the regression is moved first, by its zeros alone unless
left-out trajectories show more: an arm that warms up or is homed anew has other zeros, which points with near
neighbours alone cannot say of the whole workspace. Intervals are calibrated anew on left-out new trajectories.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import product

import numpy as np
from scipy.special import stdtrit

from gpcorrect.calibration.cartesian import CommandCorrector
from gpcorrect.calibration.dataset import Samples, folds_of, held_out
from gpcorrect.calibration.domain import Bounds, Domain
from gpcorrect.calibration.evaluate import Evaluation, evaluate_model
from gpcorrect.calibration.history import step_now
from gpcorrect.calibration.joint_route import JointRoute
from gpcorrect.calibration.law import Law
from gpcorrect.calibration.learners import GPMap, PolynomialMap
from gpcorrect.calibration.learners.gp import CLEARLY
from gpcorrect.calibration.pose_joints import PoseJoints
from gpcorrect.calibration.poses import PosePairs
from gpcorrect.calibration.task import Corrector, Measured, Part, recording_entry
from gpcorrect.calibration.unlike_training import OTHER_OR_MOVED, clean_changed
from gpcorrect.errors import DataError
from gpcorrect.gpr import IntervalCalibration, LeftOut, Statistics
from gpcorrect.gpr.statistics import Points, collected, resting_on
from gpcorrect.logs.copies import marks_of
from gpcorrect.one_thread import on_one_thread
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal, Progress

KEEPS = (1.0, 0.5, 0.2, 0.05)  # weights of the old data to choose from; chosen by hand
WORTH_FORGETTING = 1.02  # old data lose weight only where that lowers the squared error by more; chosen by hand
STIFFNESS = (1e9, 0.1, 1e-3)
"""Penalties on what is added to a linear law's slopes, for unit spreads in training: the first moves the zeros alone.
Of 13 new trajectories of an unchanged arm all slopes, free, took the error of joint 1 from .33 to .34 to .44 degrees,
for every trajectory has its own slack; of a warm one zeros took .73 to .30, slopes .33. Chosen by hand."""
ENOUGH = 5  # new trajectories from which intervals are calibrated on them alone; chosen by hand
TOLERATED, ALWAYS_WORSE = 0.01, 0.05
"""Relative growth of a held-out error up to which it is not called worse, and beyond which it always is; between them
it is where the trajectories say so beyond chance, by Student's t (95 %, one side). Chosen by hand."""


@dataclass(frozen=True, eq=False)
class Update:
    """An updated model and what it changed.

    Parameters
    ----------
    corrector : Corrector, learned from the old data and those of `log` that were not held out
    keep : float, weight of the old data, 1 for all of it; the mean of outputs, which forget each by itself
    n_added : int, samples added
    unseen : float
        Fraction of the new samples that the model's points see less of than of nearly all left-out motion of the
        training: a few hundredths for motion of the same kind, large when it went where the training never was, which
        needs a new fit.
    before, after : Evaluation or None
        Old and new model on the held-out trajectories of the new log; None when nothing was held out.
    """

    corrector: Corrector
    keep: float
    n_added: int
    unseen: float
    before: Evaluation | None
    after: Evaluation | None

    @property
    def worse(self) -> tuple[str, ...]:
        """Parts ("position", "joint 2") whose held-out error grew beyond chance."""
        if self.before is None or self.after is None:
            return ()
        old, new = self.before.clean, self.after.clean
        grown = []
        for part in self.corrector.parts(new.corrected.shape[1]):
            before, after = (_squares(measured, part) for measured in (old, new))
            growth, more = np.sqrt(after.mean() / max(before.mean(), np.finfo(float).tiny)) - 1, after - before
            chance = stdtrit(len(more) - 1, 0.95) * more.std(ddof=1) / np.sqrt(len(more)) if len(more) > 1 else 0.0
            grown += [part.name] if growth > (TOLERATED if more.mean() > chance else ALWAYS_WORSE) else []
        return tuple(grown)


def _squares(measured: Measured, part: Part) -> FloatArray:
    """Return the mean squared error `(t,)` of each trajectory in a part."""
    squares = np.nansum(measured.corrected[:, part.columns] ** 2, axis=1)
    return np.array([squares[measured.trajectory == label].mean() for label in np.unique(measured.trajectory)])


@on_one_thread
def update_model(
    corrector: Corrector, log: CalibrationLog, *, holdout: float = 0.2, progress: Progress | None = None
) -> Update:
    """Add the observations of a log, and measure old and new model on trajectories of it that were held out.

    Parameters
    ----------
    corrector : Corrector, whose laws are Gaussian processes
    log : CalibrationLog, new observations
    holdout : float, fraction of its trajectories to measure on
    progress : Progress, optional, receives the progress of the update

    Raises
    ------
    LogError
        The log lacks signals, or too few trajectories to hold one out; or it names another arm, or is of another frame.
    DataError
        The model's method cannot take more data, or the log's stamps cannot be seconds.
    """
    corrector.refuse_other_arm(log)
    log = corrector.in_joint_order(log)
    held = held_out(log, holdout)
    train = log.select(~held) if held.any() else log
    progress = progress or Progress()
    # By its own thresholds: the training's would reject an arm that changed.
    usual = corrector.clean(train)
    if usual.keep.any():
        keep = corrector.clean_afresh(train).keep
    else:
        hint = "Where tracker, base or tool were moved, or the arm was rebuilt, fit anew: gpcorrect fit"
        keep = clean_changed(corrector, train, usual, OTHER_OR_MOVED, hint).keep
    samples = corrector.samples(train, keep)
    law, weight, unseen, _ = _learn(corrector.law, samples, progress)
    changed: Corrector = replace(corrector, law=law)
    if isinstance(corrector, CommandCorrector) and corrector.memory is not None:
        samples = corrector.samples(train, keep, with_memory=True)
        law, weight, unseen, _ = _learn(corrector.memory.law, samples, progress)
        changed = replace(corrector, law=changed.law, memory=replace(corrector.memory, law=law))
    if isinstance(corrector, CommandCorrector) and corrector.route is not None:
        pairs = PosePairs.of(train, keep, corrector.velocity_steps)
        pair = (corrector.rigid.apply(pairs.observed), pairs.command)
        route, samples, weight, unseen = _learn_route(corrector.route, train.select(pairs.rows), pair, progress)
        changed = replace(corrector, law=changed.law, route=route)
    n = len(samples.rows)
    entry = {**recording_entry(log, marks_of(train)), "n_added": n, "keep": weight}
    summary = {**corrector.summary, "updates": [*corrector.summary.get("updates", []), entry]}
    step = step_now("update", log)
    changed = replace(changed.having_seen(train, keep), summary=summary, history=(*corrector.history, step))
    if not held.any():
        return Update(changed, weight, n, unseen, None, None)
    cleaning = corrector.clean_afresh(log.select(held))
    before, after = (evaluate_model(c, log, cleaning, held=held) for c in (corrector, changed))
    changed = replace(changed, history=(*corrector.history, replace(step, held_out=after.held_out())))
    return Update(changed, weight, n, unseen, before, after)


def _learn_route(
    route: JointRoute, log: CalibrationLog, pair: tuple[PoseSignal, PoseSignal], progress: Progress
) -> tuple[JointRoute, Samples, float, float]:
    """Return the route that learned from a log of poses too, its samples, and the rest of :func:`_learn`.

    Intervals of poses are calibrated anew as those of the joints are: errors that have changed in the joints have
    changed in the poses.
    """
    joints = PoseJoints.of(log, pair, route.kinematics)
    samples = route.joints.samples(joints.log, joints.known)
    law, weight, unseen, left_out = _learn(route.joints.law, samples, progress)
    aim = route.aim
    if aim is not None:
        back = aim.reached.samples(joints.log, np.ones(len(log), dtype=bool))
        learned, _, _, missed = _learn(aim.reached.law, back, progress)
        arrivals = aim.arrivals and _widest(aim.arrivals, route.arrivals(joints, aim.reached.view, back, missed))
        aim = replace(aim, reached=replace(aim.reached, law=learned), arrivals=arrivals)
    route = replace(route, aim=aim, joints=replace(route.joints, law=law))
    fresh, _ = route.calibrated(joints, samples, left_out, route.commands(joints, samples, left_out))
    if len(np.unique(samples.trajectory[samples.rows])) < ENOUGH:
        fresh = replace(fresh, intervals=_widest(fresh.intervals, route.intervals))
    return fresh, samples, weight, unseen


def _learn(law: Law, samples: Samples, progress: Progress) -> tuple[Law, float, float, LeftOut]:
    """Return the law that learned from the samples too, the weight of the old data, what points cannot see.

    And last what is left of the samples, each predicted without its own fold.
    """
    learned = law.learned
    if not isinstance(learned, GPMap):
        raise DataError("only Gaussian processes take more data.", hint="Fit again: --method gp")
    X, target = samples.learnable()
    correction = target - samples.origin[samples.rows]
    # The region first: a linear law is asked there, and not at the edge of the old one.
    bounded, near = len(law.domain.low), law.domain.near
    domain = law.domain.widened(Domain.of(X[:, :bounded], np.zeros(bounded), law.domain.novelty, correction))
    inputs = replace(law, domain=domain).inputs(X)
    left = target - law.zero
    chosen, trajectory = X[:, learned.columns], samples.trajectory[samples.rows]
    folds, moved = folds_of(trajectory), np.ones(left.shape[1])
    mean, _, novelty = learned.predictor.mean_std_batch(chosen)
    if learned.linear is not None:
        linear, left, moved = _moved(learned, inputs, left, mean, folds)
        learned = replace(learned, linear=linear)
    points = tuple(map(Points.of, learned.predictor.parts))
    by_fold = [collected(points, chosen[folds == f], left[folds == f]) for f in np.unique(folds)]
    new = tuple(reduce(Statistics.plus, group) for group in zip(*by_fold, strict=True))
    tries = []
    for i, keep in enumerate(KEEPS):
        tries.append(_left_out(points, learned.statistics, chosen, left, folds, by_fold, new, keep))
        progress.step("weight of the old data", (i + 1) / len(KEEPS))
    # What the fit found no field for has none still, unless there clearly is one now.
    none = ~np.concatenate([old.Vy.any(axis=0) for old in learned.statistics])
    idle = np.array([none & ((errors**2).sum(axis=0) > CLEARLY * (left**2).sum(axis=0)) for errors, _ in tries])
    errors = np.where(idle[:, None], left, np.array([errors for errors, _ in tries]))
    sizes = [len(own.offset) for own in points]
    best = _first_good(errors, left, sizes)
    each = np.repeat(best, sizes), np.arange(left.shape[1])
    left_out = LeftOut(
        errors[each[0], :, each[1]].T, np.array([std for _, std in tries])[each[0], :, each[1]].T, np.zeros(len(X))
    )
    used = np.split(~idle[each], np.cumsum(sizes)[:-1])
    statistics = tuple(
        old.plus(replace(added, Vy=added.Vy * some), KEEPS[i])
        for old, added, some, i in zip(learned.statistics, new, used, best, strict=True)
    )
    intervals = IntervalCalibration.fit(left_out.errors, left_out.std, trajectory, folds).widened(samples.widening)
    if len(np.unique(trajectory)) < ENOUGH:
        intervals = _widest(intervals, law.intervals)
    # Outside the region intervals are as wide as they were, by deviations in what these are worth now.
    spread = law.domain.spread * law.intervals.factor / np.maximum(intervals.factor, np.finfo(float).tiny)
    near = None if near is None else near.joined(X[:, :bounded])
    changed = Law(
        learned=replace(learned, predictor=resting_on(points, statistics), statistics=statistics),
        intervals=intervals,
        domain=replace(domain, spread=spread, near=near),
        bounds=law.bounds.widened(Bounds.of(correction, law.bounds.sizes)),
        zero=law.zero,
    )
    unseen = float((novelty > law.domain.novelty).mean())
    keep = float(np.minimum(moved, np.array(KEEPS)[each[0]]).mean())
    return changed, keep, unseen, left_out


def _moved(
    learned: GPMap, X: FloatArray, targets: FloatArray, field: FloatArray, folds: IntArray
) -> tuple[PolynomialMap, FloatArray, FloatArray]:
    """Return the linear law of old and new data, what left-out folds leave of the new ones, the outputs' old weights.

    As if the old samples lay as the new ones do: then the law of both is the old one and, of what the new samples
    differ from it by, the share that they are of all.

    Parameters
    ----------
    learned : GPMap, of the old data, with a linear law
    X, targets : (n, d) and (n, m) arrays, new inputs and targets
    field : (n, m) array, what the regression says of these
    folds : (n,) int array, what is left out together
    """
    assert learned.linear is not None
    law, count = learned.linear, learned.statistics[0].n
    left = targets - law.mean(X)

    def added(rows: BoolArray, keep: float, penalty: float) -> PolynomialMap:
        penalties = np.full((X.shape[1], targets.shape[1]), penalty)
        change = PolynomialMap.fit(X[rows], (left - field)[rows], 1, penalties, law.scaler)
        return replace(change, weights=change.weights * rows.sum() / (rows.sum() + keep * count))

    # First as it was: an unchanged arm's law is not moved by chance.
    choices, tries = [(np.inf, STIFFNESS[0]), *product(KEEPS, STIFFNESS)], []
    for choice in choices:
        rest = left.copy()
        for fold in np.unique(folds):
            rest[folds == fold] -= added(folds != fold, *choice).mean(X[folds == fold])
        tries.append(rest)
    errors, outputs = np.array(tries), np.arange(left.shape[1])
    best = _first_good(errors - field, left - field, [1] * len(outputs))
    every = np.array([added(np.ones(len(X), dtype=bool), *choice).weights for choice in choices])
    law = replace(law, weights=law.weights + every[best, :, outputs].T)
    return law, errors[best, :, outputs].T, np.minimum([keep for keep, _ in choices], 1.0)[best]


def _first_good(errors: FloatArray, scale: FloatArray, sizes: Sequence[int]) -> IntArray:
    """Return for each group of so many outputs the first of k errors `(k, n, m)` about as small as any.

    Squares count, each output's by the scatter of `scale` (n, m).
    """
    squares = ((errors / scale.std(axis=0)) ** 2).mean(axis=1)
    grouped = np.add.reduceat(squares, np.cumsum([0, *sizes[:-1]]), axis=1)
    return np.asarray((grouped <= WORTH_FORGETTING * grouped.min(axis=0)).argmax(axis=0))


def _widest(one: IntervalCalibration, other: IntervalCalibration) -> IntervalCalibration:
    return IntervalCalibration(np.maximum(one.factor, other.factor))


def _left_out(
    points: Sequence[Points],
    learned: Sequence[Statistics],
    X: FloatArray,
    Y: FloatArray,
    folds: IntArray,
    by_fold: Sequence[tuple[Statistics, ...]],
    new: tuple[Statistics, ...],
    keep: float,
) -> tuple[FloatArray, FloatArray]:
    """Errors and standard deviations `(n, m)` at new samples, those of the same fold left out."""
    errors, std = np.empty((2, *Y.shape))
    for fold, own in zip(np.unique(folds), by_fold, strict=True):
        rows = folds == fold
        rest = [old.plus(a.minus(b), keep) for old, a, b in zip(learned, new, own, strict=True)]
        mean, std[rows], _ = resting_on(points, rest).mean_std_batch(X[rows])
        errors[rows] = Y[rows] - mean
    return errors, std
