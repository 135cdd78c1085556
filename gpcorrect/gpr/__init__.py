"""Gaussian-process regression of the residual: features, posteriors, the hot path, honest intervals."""

from gpcorrect.gpr.calibration import IntervalCalibration, coverage_by_group, novelty_limit
from gpcorrect.gpr.evidence import LeftOut, learn_inflation
from gpcorrect.gpr.exact import ExactGPR, conditioned
from gpcorrect.gpr.features import FeatureMap
from gpcorrect.gpr.kernels import AdditiveRBF
from gpcorrect.gpr.predictor import Predictor
from gpcorrect.gpr.sparse import SparseGPR
from gpcorrect.gpr.statistics import Statistics

__all__ = [
    "AdditiveRBF",
    "ExactGPR",
    "FeatureMap",
    "IntervalCalibration",
    "LeftOut",
    "Predictor",
    "SparseGPR",
    "Statistics",
    "conditioned",
    "coverage_by_group",
    "learn_inflation",
    "novelty_limit",
]
