"""Where the tool really is, from the robot's own state: learned from a tracker's labels, needs no sensor afterwards."""

from gpcorrect.estimator.data import EstimatorData, estimator_data
from gpcorrect.estimator.estimator import EstimatorMethod, EstimatorStream, PositionEstimate, PositionEstimator
from gpcorrect.estimator.fit import (
    ESTIMATOR_METHODS,
    EstimatorExperiment,
    EstimatorSettings,
    evaluate_estimator,
    fit_estimator,
)
from gpcorrect.estimator.state import RobotState, state_columns

__all__ = [
    "ESTIMATOR_METHODS",
    "EstimatorData",
    "EstimatorExperiment",
    "EstimatorMethod",
    "EstimatorSettings",
    "EstimatorStream",
    "PositionEstimate",
    "PositionEstimator",
    "RobotState",
    "estimator_data",
    "evaluate_estimator",
    "fit_estimator",
    "state_columns",
]
