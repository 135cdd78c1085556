"""Joint-space calibration: trajectories, data sets, features and calibrators, from reported joints to true ones."""

from gpcorrect.joint.cable_ukf import CableFilter, CableModel, learn_cable
from gpcorrect.joint.calibrators import Calibrator, NetworkCalibrator, PolynomialCalibrator
from gpcorrect.joint.coupled_play import CoupledPlay
from gpcorrect.joint.dataset import Direction, InputSignal, JointData, check_moves, joint_data
from gpcorrect.joint.excitation import amplitude_ladder, holds, random_sinusoids, random_sweeps, speed_ladder
from gpcorrect.joint.features import FeatureKind, JointFeatures, feature_kinds
from gpcorrect.joint.maps import ErrorMap, NetworkMap, PolynomialMap
from gpcorrect.joint.timing import TimedPath, timed
from gpcorrect.joint.zero import zero_path
from gpcorrect.joint.zigzag import DIRECTIONS, direction_named, zigzag

__all__ = [
    "DIRECTIONS",
    "CableFilter",
    "CableModel",
    "Calibrator",
    "CoupledPlay",
    "Direction",
    "ErrorMap",
    "FeatureKind",
    "InputSignal",
    "JointData",
    "JointFeatures",
    "NetworkCalibrator",
    "NetworkMap",
    "PolynomialCalibrator",
    "PolynomialMap",
    "TimedPath",
    "amplitude_ladder",
    "check_moves",
    "direction_named",
    "feature_kinds",
    "holds",
    "joint_data",
    "learn_cable",
    "random_sinusoids",
    "random_sweeps",
    "speed_ladder",
    "timed",
    "zero_path",
    "zigzag",
]
