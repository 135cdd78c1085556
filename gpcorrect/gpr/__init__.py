"""Gaussian-process regression of the residual: features, posteriors, the hot path, honest intervals."""

from gpcorrect.gpr.calibration import IntervalCalibration, coverage_by_group, novelty_limit
from gpcorrect.gpr.exact import ExactGPR
from gpcorrect.gpr.features import FeatureMap
from gpcorrect.gpr.predictor import Predictor
from gpcorrect.gpr.sparse import SparseGPR

__all__ = [
    "ExactGPR",
    "FeatureMap",
    "IntervalCalibration",
    "Predictor",
    "SparseGPR",
    "coverage_by_group",
    "novelty_limit",
]
