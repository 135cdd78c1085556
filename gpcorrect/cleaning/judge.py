"""The rules, asked one after the other of samples whose ruler is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.cleaning.frozen import frozen_travel
from gpcorrect.cleaning.jumps import Pieces, excursions, largest_chain, split_pieces
from gpcorrect.cleaning.limits import PhysicalLimit, RotationLimit, Workspace
from gpcorrect.cleaning.reasons import Reason
from gpcorrect.cleaning.samples import Samples, part_norms
from gpcorrect.cleaning.settings import CleaningSettings
from gpcorrect.cleaning.smooth import SecondLook
from gpcorrect.cleaning.steps import Path, StepLimit, StepRuler
from gpcorrect.cleaning.trajectories import SURROUNDED, rejected_nearby
from gpcorrect.cleaning.verdicts import Verdicts
from gpcorrect.types import BoolArray, FloatArray, IntArray

__all__ = ["Ruler", "judge_motion", "judge_samples"]

SMOOTH_LEEWAY = 1.25  # a piece that leaves the model smoothly and comes back is more likely a gap of the model
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


def judge_samples(samples: Samples, ruler: Ruler, settings: CleaningSettings) -> Verdicts:
    """Physical limits and frozen observations."""
    verdicts = Verdicts.none(len(samples))
    limits: tuple[PhysicalLimit, ...] = (ruler.workspace, RotationLimit(settings.max_rotation))
    for limit in limits:
        values = limit.measure(samples)
        verdicts = verdicts.rejecting(values > limit.limit, limit.reason, values, limit.limit)
    travel = frozen_travel(samples)
    return verdicts.rejecting(travel > settings.frozen_travel, Reason.FROZEN, travel, settings.frozen_travel)


def judge_motion(
    samples: Samples, verdicts: Verdicts, look: SecondLook, ruler: Ruler, settings: CleaningSettings
) -> Verdicts:
    """Which samples can be one motion, and which of them the rigid and the smooth model explain.

    Parameters
    ----------
    samples : Samples
        n samples.
    verdicts : Verdicts
        On these n so far; rejected samples take no part.
    look : SecondLook
        How the samples look beside the smooth model.
    ruler, settings
        Limits and factors.
    """
    left = np.flatnonzero(verdicts.keep)
    if len(left) == 0:
        return verdicts
    path, limits = Path.of(samples[left], look.along[left], settings.response_time), ruler.steps.limits
    pieces = split_pieces(path, limits)
    from_rigid = _piece_medians(pieces, (part_norms(path.samples.error) / ruler.scales).max(axis=1))
    from_smooth = _piece_medians(pieces, look.distance[left])
    badness = np.maximum(from_rigid / settings.outlier_factor, from_smooth / settings.offset_factor)
    occlusion = _occlusion_samples(path, settings)
    scores = pieces.counts * (1 - badness**2)
    away = excursions(pieces, (scores > 0) & (pieces.counts >= FEW), path, ruler.steps, look.remainder[left], occlusion)
    kept = largest_chain(pieces, np.where(away, 0.0, scores), path, limits, occlusion)
    verdicts = _reject_pieces(verdicts, left, pieces, from_rigid, Reason.OUTLIER, settings.outlier_factor)
    verdicts = _reject_pieces(verdicts, left, pieces, from_smooth, Reason.OFFSET, settings.offset_factor)
    verdicts = _reject_unconnected(verdicts, left, pieces, ~kept, limits)
    smoothly_off = SMOOTH_LEEWAY * settings.offset_factor
    verdicts = verdicts.rejecting(look.distance > smoothly_off, Reason.OFFSET, look.distance, smoothly_off)
    nearby = rejected_nearby(samples.run, verdicts.keep)
    return verdicts.rejecting(nearby > SURROUNDED, Reason.SURROUNDED, nearby, SURROUNDED)


def _occlusion_samples(path: Path, settings: CleaningSettings) -> float:
    """Count the samples of the longest occlusion: what an impossible step inside a chain must be worth."""
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


def _reject_pieces(
    verdicts: Verdicts, rows: IntArray, pieces: Pieces, values: FloatArray, reason: Reason, limit: float
) -> Verdicts:
    """Reject the pieces whose value (m,) exceeds the limit."""
    value = _spread(np.where(values > limit, values, np.nan), len(verdicts.keep), rows, pieces)
    return verdicts.rejecting(np.isfinite(value), reason, value, limit)


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
