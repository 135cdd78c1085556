"""Gaussian-process regression of the residual: features, posteriors, the hot path, honest intervals."""

from gpcorrect.gpr.exact import ExactGPR, conditioned
from gpcorrect.gpr.features import FeatureMap
from gpcorrect.gpr.inflation import INFLATIONS, LeftOut, learn_inflation
from gpcorrect.gpr.intervals import IntervalCalibration, novelty_limit
from gpcorrect.gpr.kernels import AdditiveMatern52, AdditiveRBF, Kernel, WithLinear
from gpcorrect.gpr.predictor import Predictor, SharedPredictor
from gpcorrect.gpr.sparse import SparseGPR
from gpcorrect.gpr.statistics import Statistics

__all__ = [
    "INFLATIONS",
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
    "learn_inflation",
    "novelty_limit",
]
