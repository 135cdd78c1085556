"""A fitted joint calibration: from the joints that are reported to the true ones, or from desired ones to commands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Self

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.joint import (
    CableModel,
    Direction,
    InputSignal,
    JointData,
    JointFeatures,
    NetworkMap,
    PolynomialMap,
    joint_data,
)
from gpcorrect.joint_corrector.gp import GPMap
from gpcorrect.packing import pack, unpack
from gpcorrect.types import CalibrationLog, FloatArray

__all__ = ["JointCorrector", "JointEstimate", "Method"]

Method = Literal["offset", "linear", "quadratic", "network", "ukf", "gp"]
LEAST_RUN_SECONDS = 5.0
MOVED_STDS = 1.0  # a mean error of this many standard deviations of the model is no chance any more


def zero_shift(left: FloatArray, std: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the median `(d,)` of errors that a model leaves `(n, d)`, and the same with 0 where that may be chance."""
    middle = np.median(left, axis=0)
    return middle, np.where(np.abs(middle) > MOVED_STDS * np.nanmedian(std, axis=0), middle, 0.0)


@dataclass(frozen=True, eq=False)
class JointEstimate:
    """Corrected joints `(n, d)` and their standard deviations, rad or m."""

    q: FloatArray
    std: FloatArray


@dataclass(frozen=True, eq=False)
class JointCorrector:
    """What was learned of one arm's joints.

    Parameters
    ----------
    method : str
        Which calibrator.
    direction : str
        "estimate" or "command".
    input_signal : str
        Signal of the robot's side.
    types : str
        "R" or "P" for each joint.
    features : JointFeatures
        What the calibrator looks at.
    learned : PolynomialMap, NetworkMap, GPMap or CableModel
        Predicts the error, or filters.
    zero : (d,) array
        Added to every estimate: where the zeros stand now.
    offset : (d,) array
        Mean error in training: what a fixed offset would have corrected.
    end_to_end : bool
        Whether the map predicts the positions themselves, not their error.
    summary : mapping
        Counts, seconds and settings of the fit.
    """

    method: Method
    direction: Direction
    input_signal: InputSignal
    types: str
    features: JointFeatures
    learned: PolynomialMap | NetworkMap | GPMap | CableModel
    zero: FloatArray
    offset: FloatArray
    end_to_end: bool = False
    summary: Mapping[str, Any] = field(default_factory=dict)

    def data(self, log: CalibrationLog, *, needs_truth: bool = False) -> JointData:
        """Return the log as this model sees it.

        Raises
        ------
        LogError
            A signal is missing or cannot be right.
        DataError
            The log has other joints.
        """
        data = joint_data(log, self.input_signal, self.direction, needs_truth=needs_truth)
        if data.q.shape[1] != len(self.types):
            raise DataError(f"the model knows {len(self.types)} joints, the log has {data.q.shape[1]}.")
        return data

    def estimate(self, data: JointData) -> JointEstimate:
        """Return corrected joints of a path; rows with a missing number are NaN."""
        if isinstance(self.learned, CableModel):
            q, std = self.learned.estimate(data)
            return JointEstimate(q + self.zero, std)
        X = self.features.transform(data)
        known = np.isfinite(X).all(axis=1)
        mean, std = (np.full(data.q.shape, np.nan) for _ in range(2))
        if known.any():
            mean[known], std[known] = self.learned.predict(X[known])
        base = 0.0 if self.end_to_end else data.q
        return JointEstimate(base + mean + self.zero, std)

    def rezeroed(self, log: CalibrationLog) -> Self:
        """Return the model with its zeros set anew from a short run, as after a homing: all else stays.

        Raises
        ------
        DataError
            The run has less than five seconds with outside encoders, or is of more than one session.
        """
        sessions = np.unique(log.session)
        if len(sessions) > 1:
            raise DataError(
                f"every homing has zeros of its own; the run is of {len(sessions)} sessions.",
                hint="Give one recording, made after the last homing.",
            )
        left, seconds = self._left(log)
        if seconds < LEAST_RUN_SECONDS:
            raise DataError(
                f"new zeros need at least {LEAST_RUN_SECONDS:g} s of motion with external_jp, got {seconds:.1f} s.",
                hint="Record a minute over the whole range.",
            )
        return replace(self, zero=self.zero + np.median(left, axis=0))

    def moved(self, log: CalibrationLog) -> FloatArray:
        """Return how far each zero seems to have moved, `(d,)` rad or m; 0 where that may be chance."""
        left, _ = self._left(log)
        std = self.estimate(self.data(log)).std
        return zero_shift(left, std)[1]

    def _left(self, log: CalibrationLog) -> tuple[FloatArray, float]:
        data = self.data(log, needs_truth=True)
        assert data.truth is not None
        left = data.truth - self.estimate(data).q
        known = np.isfinite(left).all(axis=1)
        return left[known], float(np.ptp(data.time[known])) if known.any() else 0.0

    def to_parts(self) -> tuple[dict[str, Any], dict[str, FloatArray]]:
        """Return JSON-able data and arrays, for a model file."""
        return pack(self, "model")

    @classmethod
    def from_parts(cls, data: Mapping[str, Any], arrays: Mapping[str, FloatArray]) -> Self:
        """Rebuild from :meth:`to_parts`.

        Raises
        ------
        DataError
            The data do not describe a joint calibration.
        """
        kind: type = MAPS.get(data["method"], PolynomialMap)
        parts = {
            "features": unpack(JointFeatures, data["features"], arrays),
            "learned": unpack(kind, data["learned"], arrays),
            **{name: unpack(np.ndarray, data[name], arrays) for name in ("zero", "offset")},
        }
        return cls(**{**data, **parts})


MAPS: dict[str, type] = {"network": NetworkMap, "ukf": CableModel, "gp": GPMap}
