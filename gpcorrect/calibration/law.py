"""One learned law with its region, bounds and intervals: every answer of every task passes through it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.calibration.dataset import Samples
from gpcorrect.calibration.domain import Bounds, Domain
from gpcorrect.calibration.learners import CableModel, GPMap, MixedMap, NetworkMap, PolynomialMap, TreesMap
from gpcorrect.correction import Reason
from gpcorrect.errors import DataError
from gpcorrect.gpr import IntervalCalibration
from gpcorrect.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Prediction:
    """Predictions of a law for n samples."""

    # (n, m) each: correction, its standard deviation and the half width of its 95 % interval; NaN where an input is
    # missing
    residual: FloatArray
    std: FloatArray
    interval95: FloatArray
    reasons: IntArray  # (n,) :class:`gpcorrect.correction.Reason` codes


@dataclass(frozen=True, eq=False)
class Law:
    """What was learned of a residual, its calibrated intervals, its region and its bounds."""

    # mean, standard deviation and novelty of the residual
    learned: GPMap | PolynomialMap | NetworkMap | TreesMap | MixedMap | CableModel
    # what turns standard deviations into 95 % intervals that hold on unseen trajectories
    intervals: IntervalCalibration
    domain: Domain  # region in which answers can be trusted
    bounds: Bounds  # largest believed residual
    zero: FloatArray  # (m,) added to every residual: where the zeros stand now

    def __post_init__(self) -> None:
        together, limits = sum(self.bounds.sizes), (len(self.bounds.sizes), len(self.bounds.largest))
        if not len(self.zero) == len(self.domain.spread) == together or limits[0] != limits[1]:
            raise DataError(
                f"a law of {len(self.zero)} numbers does not fit together: it bounds {together} of them in"
                f" {limits[0]} groups with {limits[1]} limits, and knows the spread of {len(self.domain.spread)}."
            )

    def predict(self, samples: Samples) -> Prediction:
        """Return predictions for samples, in order; those of one path follow each other.

        Parameters
        ----------
        samples : Samples, n samples
        """
        if not isinstance(self.learned, CableModel):
            return self.predict_rows(samples.X, samples.origin, samples.unsure)
        mean, std = self.learned.errors(samples)
        return self.guarded(mean, std, np.zeros(len(samples)), samples.X, np.asarray(np.isfinite(mean).all(axis=1)))

    def predict_rows(
        self, X: FloatArray, origin: FloatArray | float = 0.0, unsure: FloatArray | None = None
    ) -> Prediction:
        """Return predictions for inputs, of a law that needs no path.

        Parameters
        ----------
        X : (n, d) array, inputs; a row with a NaN is missing
        origin, unsure : (n, m) and (n, d) arrays, optional, see :class:`Samples`
        """
        assert not isinstance(self.learned, CableModel)
        mean, std = np.full((2, len(X), len(self.zero)), np.nan)
        novelty, rows = np.zeros(len(X)), np.asarray(np.isfinite(X).all(axis=1))
        off = rows & (False if unsure is None else unsure.any(axis=1))
        ends = [] if unsure is None else [X[off] + side * unsure[off] for side in (-1, 1)]
        if rows.any():
            n, asked = int(rows.sum()), np.concatenate([X[rows], *ends])
            found, deviation, new = self.learned.predict(self.inputs(asked))
            mean[rows], std[rows], novelty[rows] = found[:n], deviation[:n], new[:n]
            low, high = np.split(found[n:], 2)
            std[off] = np.hypot(std[off], (high - low) / 2)
        return self.guarded(mean - origin, std, novelty, X, rows)

    def unguarded_one(self, x: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Return what the learner alone says of one input: mean and deviation `(m,)`, novelty.

        Single poses ask so, whose bounds and reasons are in machine code; of a Gaussian process, so is this.

        Parameters
        ----------
        x : (d,) array, inputs
        """
        if isinstance(self.learned, GPMap):
            return self.learned.predictor.mean_std(x)
        assert not isinstance(self.learned, CableModel)
        mean, std, novelty = self.learned.predict(self.inputs(x[None]))
        return mean[0], std[0], float(novelty[0])

    def unknown(self) -> Prediction:
        """Return the prediction of one row that lacks a number."""
        nothing = np.full((1, len(self.zero)), np.nan)
        return Prediction(nothing, nothing, nothing, np.array([int(Reason.MISSING)]))

    def outside(self, prediction: Prediction, rows: BoolArray | bool = True) -> Prediction:
        """Return a prediction that is outside the training region at some rows, whatever its inputs say.

        Parameters
        ----------
        prediction : Prediction, n samples
        rows : (n,) mask, optional
        """
        std = self.domain.widen(prediction.std, ~np.asarray(rows))
        reasons = np.where(rows, prediction.reasons | int(Reason.OUTSIDE), prediction.reasons)
        return replace(prediction, std=std, interval95=self.intervals.interval95(std), reasons=reasons)

    def inputs(self, X: FloatArray) -> FloatArray:
        """Return inputs `(..., d)` as the learner reads them: clipped to the region where the learner extrapolates.

        Parameters
        ----------
        X : (..., d) array, inputs
        """
        return self.domain.clip(X) if not isinstance(self.learned, CableModel) and self.learned.extrapolates else X

    def guarded(
        self, mean: FloatArray, std: FloatArray, novelty: FloatArray, X: FloatArray, rows: BoolArray
    ) -> Prediction:
        """Return a prediction within bounds, with its intervals and reasons.

        Parameters
        ----------
        mean, std : (n, m) arrays, of the learner
        novelty : (n,) array, likewise
        X : (n, d) array, inputs
        rows : (n,) mask, rows that lack no number
        """
        residual, cut = self.bounds.limit(mean)
        inside = self.domain.holds(X, novelty)
        std = self.domain.widen(std, inside)
        codes = np.where(cut, int(Reason.LIMITED), 0) | np.where(inside, 0, int(Reason.OUTSIDE))
        reasons: IntArray = np.where(rows, codes, int(Reason.MISSING)).astype(np.int64)
        return Prediction(residual + self.zero, std, self.intervals.interval95(std), reasons)
