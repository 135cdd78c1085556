"""Hidden causes: the catalogue's 29 by their canonical names, and those outside it."""

from __future__ import annotations

from truth.kinds import compliance, geometry, outside, reversal, temporal
from truth.kinds.kind import Kind

__all__ = ["CATALOGUE", "OUTSIDE", "STAGES", "kind_named"]

CATALOGUE: dict[str, Kind] = geometry.KINDS | compliance.KINDS | reversal.KINDS | temporal.KINDS
OUTSIDE: dict[str, Kind] = outside.KINDS
# Path effects act from the motor to the link: the order matters where they meet
STAGES = (
    "encoder_interpolation", "homing_offset", "drift", "transmission_ratio", "climbing_cable",
    "cable_coupling", "quadratic_coupling", "pulley_eccentricity", "gear_mesh", "differential_wheel",
    "toggling_latch", "intermittent_stick", "creep", "cable_slip", "backlash", "hysteresis", "resonance",
    "thermal_gradient_bend", "gravity_sag",
)  # fmt: skip


def kind_named(name: str) -> Kind:
    """Return a hidden cause by name."""
    return CATALOGUE.get(name) or OUTSIDE[name]
