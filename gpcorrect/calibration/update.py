"""New observations into a fitted model, without its old data and without growing.

Points and hyperparameters stay; the sums over samples (:class:`gpcorrect.gpr.Statistics`) of old and new data are
added, the old ones weighted by what predicts left-out new trajectories best, so that a robot that changed is followed
and one that did not loses nothing. Intervals are calibrated anew on left-out new trajectories.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from gpcorrect.calibration.cartesian import CommandCorrector
from gpcorrect.calibration.dataset import Samples, folds_of, held_out
from gpcorrect.calibration.domain import Bounds, Domain
from gpcorrect.calibration.evaluate import Evaluation, evaluate_model
from gpcorrect.calibration.history import step_now
from gpcorrect.calibration.joint_route import JointRoute, PoseJoints
from gpcorrect.calibration.law import Law
from gpcorrect.calibration.learners import GPMap
from gpcorrect.calibration.poses import PosePairs
from gpcorrect.calibration.task import Corrector, recording_entry
from gpcorrect.errors import DataError, LogError
from gpcorrect.gpr import IntervalCalibration, LeftOut, Statistics
from gpcorrect.gpr.statistics import Points, collected, resting_on
from gpcorrect.logs.copies import marks_of
from gpcorrect.one_thread import on_one_thread
from gpcorrect.types import CalibrationLog, FloatArray, IntArray, PoseSignal, Progress

KEEPS = (1.0, 0.5, 0.2, 0.05)  # weights of the old data to choose from; chosen by hand
WORTH_FORGETTING = 1.02  # old data lose weight only where that lowers the squared error by more; chosen by hand
ENOUGH = 5  # new trajectories from which intervals are calibrated on them alone; chosen by hand
TOLERATED = 0.01  # relative growth of a held-out error that is not called worse; chosen by hand


@dataclass(frozen=True, eq=False)
class Update:
    """An updated model and what it changed.

    Parameters
    ----------
    corrector : Corrector, learned from the old data and those of `log` that were not held out
    keep : float, weight of the old data: 1 for all of it
    n_added : int, samples added
    unseen : float
        Fraction of the prior variance at the new samples that the model's points cannot see: large when the new motion
        went where the training never was, which needs a new fit.
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
        """Parts ("position", "joint 2") whose held-out error grew."""
        if self.before is None or self.after is None:
            return ()
        old, new = self.before.clean.corrected, self.after.clean.corrected
        grown = []
        for part in self.corrector.parts(new.shape[1]):
            before, after = (np.sqrt(np.nanmean(errors[:, part.columns] ** 2)) for errors in (old, new))
            grown += [part.name] if after > (1 + TOLERATED) * before else []
        return tuple(grown)


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
    held = held_out(log, holdout)
    train = log.select(~held) if held.any() else log
    progress = progress or Progress()
    # By its own thresholds: the training's would reject an arm that changed.
    keep = corrector.clean_afresh(train).keep
    if not corrector.clean(train).keep.any():
        raise LogError(
            f"by the training's thresholds none of the {len(train)} samples is of the same robot and frames.",
            hint="Where tracker, base or tool were moved, or the arm was rebuilt, fit anew: gpcorrect fit",
            path=log.name,
        )
    samples = corrector.samples(train, keep)
    law, weight, unseen, _ = _learn(corrector.law, samples, progress)
    changed: Corrector = replace(corrector, law=law)
    if isinstance(corrector, CommandCorrector) and corrector.memory is not None:
        samples = corrector.samples(train, keep, with_memory=True)
        law, weight, unseen, _ = _learn(corrector.memory.law, samples, progress)
        changed = replace(corrector, law=changed.law, memory=replace(corrector.memory, law=law))
    if isinstance(corrector, CommandCorrector) and corrector.route is not None:
        pairs = PosePairs.of(train, keep, corrector.velocity_step)
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
        aim = replace(aim, reached=replace(aim.reached, law=_learn(aim.reached.law, back, progress)[0]))
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
    left = target - law.zero - (0.0 if learned.linear is None else learned.linear.mean(inputs))
    chosen, trajectory = X[:, learned.columns], samples.trajectory[samples.rows]
    folds = folds_of(trajectory)
    points = tuple(map(Points.of, learned.predictor.parts))
    by_fold = [collected(points, chosen[folds == f], left[folds == f]) for f in np.unique(folds)]
    new = tuple(reduce(Statistics.plus, group) for group in zip(*by_fold, strict=True))
    tries = []
    for i, keep in enumerate(KEEPS):
        tries.append(_left_out(points, learned.statistics, chosen, left, folds, by_fold, new, keep))
        progress.step("weight of the old data", (i + 1) / len(KEEPS))
    squares = [float(((errors / left.std(axis=0)) ** 2).mean()) for errors, _ in tries]
    best = int(np.argmax(np.array(squares) <= WORTH_FORGETTING * min(squares)))  # the first: the largest weight
    statistics = tuple(old.plus(added, KEEPS[best]) for old, added in zip(learned.statistics, new, strict=True))
    intervals = IntervalCalibration.fit(*tries[best], trajectory, folds).widened(samples.widening)
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
    unseen = max(added.unseen(len(added.G)) for added in new)
    return changed, KEEPS[best], unseen, LeftOut(*tries[best], np.zeros(len(X)))


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
