"""The rules, asked one after the other of samples whose ruler is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.cleaning.frozen import frozen_travel
from gpcorrect.cleaning.jumps import Pieces, excursions, largest_chain, split_pieces
from gpcorrect.cleaning.limits import RotationLimit, Workspace
from gpcorrect.cleaning.reasons import Reason
from gpcorrect.cleaning.samples import Samples, part_norms
from gpcorrect.cleaning.settings import CleaningSettings
from gpcorrect.cleaning.steps import Path, StepLimit, StepRuler
from gpcorrect.cleaning.trajectories import SURROUNDED, rejected_nearby
from gpcorrect.cleaning.verdicts import Verdicts
from gpcorrect.types import BoolArray, FloatArray, IntArray

__all__ = ["Ruler", "judge_motion", "judge_samples"]

FEW = 8  # samples: fewer are no motion of their own, however slow the recording


@dataclass(frozen=True, eq=False)
class Ruler:
    """What is learned from training data to judge samples by themselves and by their neighbours in time.

    Parameters
    ----------
    scales : (parts,) array
        Robust standard deviation of an error component about the rigid model, m and rad.
    workspace : Workspace
        Where observations can be.
    steps : StepRuler
        How far the error can change from sample to sample.
    """

    scales: FloatArray
    workspace: Workspace
    steps: StepRuler


def judge_samples(samples: Samples, verdicts: Verdicts, ruler: Ruler, settings: CleaningSettings) -> Verdicts:
    """Physical limits, frozen observations, and gross outliers about the rigid model."""
    for limit in (ruler.workspace, RotationLimit(settings.max_rotation)):
        values = limit.measure(samples)
        verdicts = verdicts.rejecting(values > limit.limit, limit.reason, values, limit.limit)
    travel = frozen_travel(samples)
    verdicts = verdicts.rejecting(travel > settings.frozen_travel, Reason.FROZEN, travel, settings.frozen_travel)
    away = (part_norms(samples.error) / ruler.scales).max(axis=1)
    return verdicts.rejecting(away > settings.outlier_factor, Reason.OUTLIER, away, settings.outlier_factor)


def judge_motion(
    samples: Samples, verdicts: Verdicts, distance: FloatArray, ruler: StepRuler, settings: CleaningSettings
) -> Verdicts:
    """Which samples can be one motion, and which of them the smooth model explains.

    Parameters
    ----------
    samples : Samples
        n samples.
    verdicts : Verdicts
        On these n so far; rejected samples take no part.
    distance : (n,) array
        Robust scales between each error and the smooth model's; zeros while there is no model.
    ruler, settings
        Limits and factors.
    """
    left = np.flatnonzero(verdicts.keep)
    if len(left) == 0:
        return verdicts
    path = Path.of(samples[left], settings.response_time)
    pieces = split_pieces(path, ruler.limits)
    typical = _piece_medians(pieces, distance[left])
    scores = pieces.counts * (1 - (typical / settings.offset_factor) ** 2)
    kept = largest_chain(pieces, scores, path, ruler.limits, _switch_cost(path, settings))
    kept &= ~excursions(pieces, kept, path, ruler)
    verdicts = _reject_offset(verdicts, left, pieces, scores <= 0, typical, settings)
    verdicts = _reject_unconnected(verdicts, left, pieces, ~kept, ruler.limits)
    verdicts = verdicts.rejecting(distance > settings.offset_factor, Reason.OFFSET, distance, settings.offset_factor)
    nearby = rejected_nearby(samples.run, verdicts.keep)
    return verdicts.rejecting(nearby > SURROUNDED, Reason.SURROUNDED, nearby, SURROUNDED)


def _switch_cost(path: Path, settings: CleaningSettings) -> float:
    """Samples that an impossible step inside a chain must be worth: as many as the longest occlusion has."""
    steps = np.diff(path.samples.time)
    typical = np.median(steps[steps > 0]) if (steps > 0).any() else settings.occlusion_time
    return float(max(FEW, settings.occlusion_time / typical))


def _piece_medians(pieces: Pieces, values: FloatArray) -> FloatArray:
    """Median (m,) of the values (n,) of each piece's samples."""
    return np.array([np.median(values[a : b + 1]) for a, b in zip(pieces.first, pieces.last, strict=True)])


def _spread(values: FloatArray, n: int, rows: IntArray, pieces: Pieces) -> FloatArray:
    """Values (m,) of pieces as values (n,) of all samples, NaN for those in no piece."""
    spread = np.full(n, np.nan)
    spread[rows] = values[pieces.label]
    return spread


def _reject_offset(
    verdicts: Verdicts, rows: IntArray, pieces: Pieces, mask: BoolArray, typical: FloatArray, settings: CleaningSettings
) -> Verdicts:
    n = len(verdicts.keep)
    value = _spread(np.where(mask, typical, np.nan), n, rows, pieces)
    return verdicts.rejecting(np.isfinite(value), Reason.OFFSET, value, settings.offset_factor)


def _reject_unconnected(
    verdicts: Verdicts, rows: IntArray, pieces: Pieces, mask: BoolArray, limits: Sequence[StepLimit]
) -> Verdicts:
    """Name the limit that the step into a piece breaks, or the step out of it where that breaks more."""
    out_ratio = np.append(pieces.ratio[1:], 0.0)
    leaving = out_ratio > pieces.ratio
    cause = np.where(leaving, np.append(pieces.cause[1:], 0), pieces.cause)
    ratio = np.where(mask, np.maximum(out_ratio, pieces.ratio), np.nan)
    causes = _spread(cause.astype(np.float64), len(verdicts.keep), rows, pieces)
    for k, limit in enumerate(limits):
        value = _spread(ratio * limit.limit, len(verdicts.keep), rows, pieces)
        verdicts = verdicts.rejecting(np.isfinite(value) & (causes == k), limit.reason, value, limit.limit)
    return verdicts
