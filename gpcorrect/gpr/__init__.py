"""Gaussian-process regression of the residual: features, posteriors, the hot path, honest intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gpcorrect.lazy import imported_on_demand

if TYPE_CHECKING:
    from gpcorrect.gpr.estimator import ExactGPR
    from gpcorrect.gpr.features import FeatureMap
    from gpcorrect.gpr.intervals import IntervalCalibration, LeftOut, learn_inflation, novelty_limit
    from gpcorrect.gpr.kernels import AdditiveMatern52, AdditiveRBF, Kernel, WithLinear
    from gpcorrect.gpr.linalg import conditioned, conditioned_mean, conditioned_on_others
    from gpcorrect.gpr.predictor import Predictor, SharedPredictor
    from gpcorrect.gpr.sparse import SparseGPR
    from gpcorrect.gpr.statistics import Statistics

__getattr__ = imported_on_demand(
    __name__,
    {
        "estimator": "ExactGPR",
        "features": "FeatureMap",
        "intervals": "IntervalCalibration LeftOut learn_inflation novelty_limit",
        "kernels": "AdditiveMatern52 AdditiveRBF Kernel WithLinear",
        "linalg": "conditioned conditioned_mean conditioned_on_others",
        "predictor": "Predictor SharedPredictor",
        "sparse": "SparseGPR",
        "statistics": "Statistics",
    },
)

__all__ = [
    "AdditiveMatern52",
    "AdditiveRBF",
    "ExactGPR",
    "FeatureMap",
    "IntervalCalibration",
    "Kernel",
    "LeftOut",
    "Predictor",
    "SharedPredictor",
    "SparseGPR",
    "Statistics",
    "WithLinear",
    "conditioned",
    "conditioned_mean",
    "conditioned_on_others",
    "learn_inflation",
    "novelty_limit",
]
