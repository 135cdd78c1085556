"""Robot arms: kinematics, inverse kinematics, gravity and transmission of RAVEN-II and dVRK."""

from gpcorrect.arms.arm import Arm, Solutions
from gpcorrect.arms.chain import Chain, Joint
from gpcorrect.arms.dvrk_psm import dvrk_psm
from gpcorrect.arms.gravity import Link, gravity_torque, potential_energy
from gpcorrect.arms.named import arm_named
from gpcorrect.arms.raven2 import DA_VINCI_TOOL, RAVEN_TOOL, Raven2Tool, raven2
from gpcorrect.arms.transmission import Transmission

__all__ = [
    "DA_VINCI_TOOL",
    "RAVEN_TOOL",
    "Arm",
    "Chain",
    "Joint",
    "Link",
    "Raven2Tool",
    "Solutions",
    "Transmission",
    "arm_named",
    "dvrk_psm",
    "gravity_torque",
    "potential_energy",
    "raven2",
]
