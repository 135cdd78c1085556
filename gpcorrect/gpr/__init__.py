"""Gaussian-process regression of the residual: features, exact and sparse posteriors, the hot path, honest intervals."""

from gpcorrect.gpr.calibration import IntervalCalibration
from gpcorrect.gpr.exact import ExactGPR
from gpcorrect.gpr.features import FeatureMap
from gpcorrect.gpr.predictor import Predictor
from gpcorrect.gpr.sparse import SparseGPR

__all__ = ["ExactGPR", "FeatureMap", "IntervalCalibration", "Predictor", "SparseGPR"]
