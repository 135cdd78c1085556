"""Has a model aged? A sequential test on the errors of trajectory after trajectory, with a false-alarm rate that holds.

A trajectory's score is how large its errors are beside the model's own standard deviations. Its conformal p-value is
its rank among all scores before it, those of the training's left-out trajectories first: while nothing changes,
p-values are independent and uniform, whatever the distribution of the errors (Vovk et al. 2005). Each is turned into
an e-value, mean at most 1, and these are accumulated as in CUSUM, `C = max(C, 1) e`; an alarm at `C >= A` comes once
in A trajectories or more seldom (e-detectors: Shin, Ramdas and Rinaldo 2024, Sec. 2), with no threshold to be
simulated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.corrector import CommandCorrector, LogSamples, normalised, scores_by_trajectory
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

__all__ = ["Detection", "conformal_p_values", "detect", "e_values", "trajectory_scores"]

FEWEST_BASELINE = 4
SMALLEST_P = 1e-12


@dataclass(frozen=True, eq=False)
class Detection:
    """What the sequential test saw.

    Parameters
    ----------
    scores : (n,) array
        Of the trajectories, in order.
    p_values : (n,) array
    evidence : (n,) array
        C above, after each trajectory.
    threshold : float
        A above: mean number of trajectories between false alarms, at least.
    alarm : int or None
        The first trajectory whose evidence reached the threshold.
    """

    scores: FloatArray
    p_values: FloatArray
    evidence: FloatArray
    threshold: float
    alarm: int | None


def detect(baseline: FloatArray, scores: FloatArray, threshold: float, rng: np.random.Generator) -> Detection:
    """Test scores `(n,)`, in order, against those of the training's left-out trajectories `(b,)`.

    Raises
    ------
    DataError
        Fewer than four baseline scores, or a threshold that is not above 1.
    """
    if len(baseline) < FEWEST_BASELINE:
        raise DataError(
            f"the model knows the errors of {len(baseline)} left-out trajectories; a test needs {FEWEST_BASELINE}.",
            hint="Fit a model to more trajectories.",
        )
    if not threshold > 1:
        raise DataError(f"trajectories between false alarms must be more than 1, got {threshold:g}.")
    p = conformal_p_values(baseline, scores, rng)
    evidence, level = np.empty(len(p)), 1.0
    for i, e in enumerate(e_values(p)):
        level = max(level, 1.0) * e
        evidence[i] = level
    reached = np.flatnonzero(evidence >= threshold)
    return Detection(scores, p, evidence, threshold, int(reached[0]) if reached.size else None)


def conformal_p_values(baseline: FloatArray, scores: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return p-values `(n,)`: ranks of scores among all before them, ties broken at random; small for large scores."""
    seen = np.concatenate([baseline, scores])
    p = np.empty(len(scores))
    for i, score in enumerate(scores):
        before = seen[: len(baseline) + i]
        larger, ties = np.sum(before > score), np.sum(before == score) + 1
        p[i] = (larger + rng.random() * ties) / (len(before) + 1)
    return p


def e_values(p: FloatArray) -> FloatArray:
    """Return e-values of p-values: the power bets `k p^(k - 1)` averaged over k in (0, 1) (Vovk and Wang 2021)."""
    q = np.clip(p, SMALLEST_P, 1.0 - 1e-6)
    log = np.log(q)
    bets: FloatArray = (1.0 - q + q * log) / (q * log**2)
    return bets


def trajectory_scores(corrector: CommandCorrector, samples: LogSamples) -> FloatArray:
    """Return scores, a trajectory each in the order of the log: root mean square of error over standard deviation.

    Samples outside the training region are not looked at, for there the model promises nothing; a trajectory that lies
    outside altogether has no score. Standard deviations are calibrated: a score is about 1 while the model holds.
    """
    recall = corrector.recall
    predictor, intervals, bounds, X = corrector.predictor, corrector.intervals, corrector.bounds, samples.X
    if recall is not None and samples.X_recall is not None:
        predictor, intervals, bounds, X = recall.predictor, recall.intervals, recall.bounds, samples.X_recall
    mean, std, novelty = predictor.mean_std_batch(X)
    ratio = normalised(samples.residual - mean, intervals.interval95(std))
    inside = bounds.in_domain_rows(novelty, X)
    return scores_by_trajectory(ratio[inside], samples.trajectory[inside])
