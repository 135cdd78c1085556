"""Joint calibration from log to model: fit, measure, save, set zeros anew."""

from gpcorrect.joint_corrector.ageing import piece_scores
from gpcorrect.joint_corrector.clocks import joints_on_one_clock
from gpcorrect.joint_corrector.corrector import JointCorrector, JointEstimate, Method
from gpcorrect.joint_corrector.fit import (
    METHODS,
    JointExperiment,
    JointSettings,
    evaluate_joint,
    fit_joint,
    method_named,
    require_joints,
)
from gpcorrect.joint_corrector.metrics import JointErrors, joint_units
from gpcorrect.joint_corrector.stream import JointStream

__all__ = [
    "METHODS",
    "JointCorrector",
    "JointErrors",
    "JointEstimate",
    "JointExperiment",
    "JointSettings",
    "JointStream",
    "Method",
    "evaluate_joint",
    "fit_joint",
    "joint_units",
    "joints_on_one_clock",
    "method_named",
    "piece_scores",
    "require_joints",
]
