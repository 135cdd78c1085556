"""A cable-driven arm that misses: arm, transmission, controller and sensors simulated into a calibration log."""

from gpcorrect.sim.effects import EFFECTS, Effect, effect_from_dict
from gpcorrect.sim.joint_motion import joint_motion_log
from gpcorrect.sim.live import LiveArm, Moment
from gpcorrect.sim.machine import Machine
from gpcorrect.sim.model import Model, model_from_dict, preset, preset_names, read_model, write_model
from gpcorrect.sim.plan import Plan, Segment, plan_of
from gpcorrect.sim.plant import Outcome, run
from gpcorrect.sim.reaches import debridement_log, random_reaches_log
from gpcorrect.sim.record import SIMULATED, Fault, simulate
from gpcorrect.sim.resolve import machine_of
from gpcorrect.sim.settings import Noise, TrackerFaults

__all__ = [
    "EFFECTS",
    "SIMULATED",
    "Effect",
    "Fault",
    "LiveArm",
    "Machine",
    "Model",
    "Moment",
    "Noise",
    "Outcome",
    "Plan",
    "Segment",
    "TrackerFaults",
    "debridement_log",
    "effect_from_dict",
    "joint_motion_log",
    "machine_of",
    "model_from_dict",
    "plan_of",
    "preset",
    "preset_names",
    "random_reaches_log",
    "read_model",
    "run",
    "simulate",
    "write_model",
]
