"""Drives where a model file names none: motors from their catalogue, gains from a wanted bandwidth."""

from __future__ import annotations

import numpy as np

from gpcorrect.arms import arm_named
from gpcorrect.sim.body import Body
from gpcorrect.sim.model import Controller
from gpcorrect.types import FloatArray

__all__ = ["default_controller", "motor_inertia"]

BANDWIDTH_HZ = 10.0  # undamped natural frequency of the closed loop, a common choice for cable-driven arms
DAMPING_RATIO = 1.0
ROTOR_RE40 = 1.42e-5  # kg m^2, maxon RE 40 (joints 1 to 3 of RAVEN-II)
ROTOR_RE30 = 3.35e-6  # kg m^2, maxon RE 30 (its tool joints)
TYPICAL = {"R": 0.05, "P": 5.0}  # kg m^2 and kg; where no motor is published, of the size of a surgical arm's


def motor_inertia(arm: str, body: Body) -> FloatArray:
    """Rotor inertia reflected to each moving joint `(dof,)`, kg m^2 or kg."""
    if arm.startswith("raven2"):
        transmission = arm_named(arm).transmission
        assert transmission is not None
        rotors = np.array([ROTOR_RE40] * 3 + [ROTOR_RE30] * 3)
        reflected: FloatArray = (rotors * transmission.ratios**2)[body.columns]
        return reflected
    return np.array([TYPICAL[kind] for kind in body.types])


def default_controller(inertia: FloatArray) -> Controller:
    """PD gains that give every motor the default bandwidth and damping on its own inertia `(dof,)`."""
    omega = 2 * np.pi * BANDWIDTH_HZ
    return Controller(kp=tuple((inertia * omega**2).tolist()), kd=tuple((2 * DAMPING_RATIO * omega * inertia).tolist()))
