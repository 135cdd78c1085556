"""Hidden causes: the catalogue's by their canonical names, those that are to join it, and those outside it."""

from __future__ import annotations

from truth_mujoco.causes import compliance, controller, geometry, masses, outside, reversal, temporal
from truth_mujoco.causes.cause import Cause

__all__ = ["AHEAD", "CATALOGUE", "OUTSIDE", "STAGES", "cause_named"]

CATALOGUE: dict[str, Cause] = geometry.CAUSES | compliance.CAUSES | reversal.CAUSES | temporal.CAUSES
# What the first protocol did not have: motor-side errors, masses, a law of the noise
AHEAD: dict[str, Cause] = controller.CAUSES | masses.CAUSES
OUTSIDE: dict[str, Cause] = outside.CAUSES
# Causes behind what MuJoCo moves act from the motor to the link: the order matters where they meet
STAGES = (
    "cable_derailing", "climbing_cable", "creep", "backlash", "hysteresis", "resonance", "coupled_mode",
    "thermal_growth", "gravity_sag",
)  # fmt: skip


def cause_named(name: str) -> Cause:
    """Return a hidden cause by name."""
    return (CATALOGUE | AHEAD | OUTSIDE)[name]
