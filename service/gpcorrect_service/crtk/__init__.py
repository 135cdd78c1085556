"""CRTK over zenoh: an arm's topics, an arm that serves them, a robot's client, and the correcting pre-filter."""

from gpcorrect_service.crtk.arm_server import ArmServer, ArmServerSettings
from gpcorrect_service.crtk.bus import Bus, BusSettings, in_namespace
from gpcorrect_service.crtk.messages import JointState, OperatingState, Pose, View

__all__ = [
    "ArmServer",
    "ArmServerSettings",
    "Bus",
    "BusSettings",
    "JointState",
    "OperatingState",
    "Pose",
    "View",
    "in_namespace",
]
