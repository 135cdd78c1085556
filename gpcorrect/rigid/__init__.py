"""The rigid part of the correction: registration of frames, marker offset, and the residual that is left."""

from gpcorrect.rigid.handeye import fit_marker, fit_separate
from gpcorrect.rigid.model import RigidKind, RigidModel, apply_residual, pose_residual
from gpcorrect.rigid.observability import Observability, rotation_observability
from gpcorrect.rigid.registration import fit_pose, fit_position
from gpcorrect.rigid.select import Candidate, MarkerOption, Registration, register

__all__ = [
    "Candidate",
    "MarkerOption",
    "Observability",
    "Registration",
    "RigidKind",
    "RigidModel",
    "apply_residual",
    "fit_marker",
    "fit_pose",
    "fit_position",
    "fit_separate",
    "pose_residual",
    "register",
    "rotation_observability",
]
