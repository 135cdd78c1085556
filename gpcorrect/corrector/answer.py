"""From a query's numbers to an answer: one at a time in machine code, or a stack."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from gpcorrect.corrector.bounds import Bounds
from gpcorrect.corrector.one_pose import Frame, command, inputs
from gpcorrect.corrector.queries import bad_query
from gpcorrect.gpr import IntervalCalibration, Predictor
from gpcorrect.rigid import apply_residual
from gpcorrect.types import BoolArray, Correction, CorrectionStatus, FloatArray, PoseSignal

__all__ = ["NO_MEMORY", "Answerer", "PathCorrection"]

POSITION = 3
NO_MEMORY = np.zeros(0)
LIMITED = "the learned part was cut to the largest one that training justifies"
BRIDGED = "the path jumps here faster than the arm can move: bridged by straight motion"
OUTSIDE = "outside the training region: nothing is known of how the robot misses there"


@dataclass(frozen=True, eq=False)
class PathCorrection:
    """What to command instead of a path of n desired poses.

    Parameters
    ----------
    positions : (n, 3) array
        Commanded positions, base frame, m.
    quaternions : (n, 4) array or None
        Commanded orientations wxyz; None when none were asked for.
    std, interval95 : (n, 6) arrays
        Standard deviation and half width of the 95 % interval of each component: m, then rad; NaN where not learned.
    in_domain : (n,) bool array
        Whether each pose lies near training data.
    status, reason : tuples of n str
        As in :class:`gpcorrect.types.Correction`.
    """

    positions: FloatArray
    quaternions: FloatArray | None
    std: FloatArray
    interval95: FloatArray
    in_domain: BoolArray
    status: tuple[str, ...]
    reason: tuple[str, ...]

    @classmethod
    def of(cls, answers: Sequence[Correction]) -> Self:
        """Gather answers, one at least, given one after the other."""
        quaternions = [answer.quaternion for answer in answers if answer.quaternion is not None]
        return cls(
            positions=np.array([answer.position for answer in answers]),
            quaternions=np.array(quaternions) if quaternions else None,
            std=np.array([answer.std for answer in answers]),
            interval95=np.array([answer.interval95 for answer in answers]),
            in_domain=np.array([answer.in_domain for answer in answers]),
            status=tuple(answer.status for answer in answers),
            reason=tuple(answer.reason for answer in answers),
        )

    def bridged(self, rows: BoolArray) -> Self:
        """Return the same, saying of these rows (n,) that their poses were replaced."""
        said = zip(rows.tolist(), self.status, self.reason, strict=True)
        marked = [("LIMITED", "; ".join(filter(None, (BRIDGED, why)))) if cut else (how, why) for cut, how, why in said]
        return replace(self, status=tuple(how for how, _ in marked), reason=tuple(why for _, why in marked))


@dataclass(frozen=True, eq=False)
class Answerer:
    """Answers queries from one learned residual; it changes nothing, so threads may share it.

    Parameters
    ----------
    frame : Frame
        Registration and features, as a single query reads them.
    predictor : Predictor
        Mean and standard deviation of the residual.
    intervals : IntervalCalibration
        What turns standard deviations into 95 % intervals that hold on unseen trajectories.
    bounds : Bounds
        Largest residual that is believed, and the novelty and ranges beyond which a query is extrapolation.

    Attributes
    ----------
    region : (2, d) array
        The ranges.
    """

    frame: Frame
    predictor: Predictor
    intervals: IntervalCalibration
    bounds: Bounds
    region: FloatArray = field(init=False, repr=False)
    _limits: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "region", np.array([self.bounds.low, self.bounds.high]))
        object.__setattr__(self, "_limits", np.array([self.bounds.position, self.bounds.rotation]))

    def one(self, query: FloatArray, twist: FloatArray, memory: FloatArray, remark: str) -> Correction:
        """Answer a pose `(7,)` or `(3,)` with its twist `(6,)` and memory features; `remark` says what was not used.

        Raises
        ------
        DataError
            A number is not finite, or the quaternion is not a unit one.
        """
        good, position, rotation, x, near = inputs(query, twist, memory, self.frame, self.region)
        if not good:
            raise bad_query(query, twist)
        mean, std, novelty = self.predictor.mean_std(x)
        position, quaternion, limited = command(position, rotation, mean, self._limits)
        in_domain = near and novelty <= self.bounds.novelty
        return Correction(
            position=position,
            quaternion=None if len(query) == POSITION else quaternion,
            std=_six(std),
            interval95=_six(self.intervals.interval95(std)),
            in_domain=in_domain,
            status=_status(in_domain, limited),
            reason=_reason(in_domain, limited, remark),
        )

    def many(self, reference: PoseSignal, X: FloatArray) -> PathCorrection:
        """Answer reference poses (n rows) with inputs `(n, d)` of the regression."""
        mean, std, novelty = self.predictor.mean_std_batch(X)
        residual, limited = self.bounds.limit_rows(mean)
        commanded = apply_residual(reference, _six_columns(residual, 0.0))
        in_domain = self.bounds.in_domain_rows(novelty, X)
        flags = list(zip(in_domain.tolist(), limited.tolist(), strict=True))
        return PathCorrection(
            positions=commanded.position,
            quaternions=commanded.quaternion,
            std=_six_columns(std, np.nan),
            interval95=_six_columns(self.intervals.interval95(std), np.nan),
            in_domain=in_domain,
            status=tuple(_status(near, cut) for near, cut in flags),
            reason=tuple(_reason(near, cut, "") for near, cut in flags),
        )


def _six(values: FloatArray) -> FloatArray:
    """Pad the three components of a position-only model with NaN."""
    return values if len(values) == 6 else np.concatenate([values, np.full(3, np.nan)])


def _six_columns(values: FloatArray, fill: float) -> FloatArray:
    if values.shape[1] == 6:
        return values
    return np.concatenate([values, np.full((len(values), 3), fill)], axis=1)


def _status(in_domain: bool, limited: bool) -> CorrectionStatus:
    if limited:
        return "LIMITED"
    return "OK" if in_domain else "EXTRAPOLATING"


def _reason(in_domain: bool, limited: bool, remark: str) -> str:
    if in_domain and not limited:
        return remark
    said = [(limited, LIMITED), (not in_domain, OUTSIDE), (remark, remark)]
    return "; ".join(text for holds, text in said if holds)
