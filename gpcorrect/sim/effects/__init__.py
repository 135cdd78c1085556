"""The catalogue of effects: one file each, all of one form."""

from gpcorrect.sim.effects.backlash import Backlash
from gpcorrect.sim.effects.base import Effect, Stage
from gpcorrect.sim.effects.cable_coupling import CableCoupling
from gpcorrect.sim.effects.cable_stretch import CableStretch
from gpcorrect.sim.effects.coulomb_friction import CoulombFriction
from gpcorrect.sim.effects.description import Description, Family, Neighbour, Parameter, Range, Run
from gpcorrect.sim.effects.drift import Drift
from gpcorrect.sim.effects.gravity_sag import GravitySag
from gpcorrect.sim.effects.homing_offset import HomingOffset
from gpcorrect.sim.effects.operators import play
from gpcorrect.sim.effects.registry import EFFECTS, effect_from_dict, in_order, of_kind
from gpcorrect.sim.effects.stages import (
    ChainEffect,
    Friction,
    FrictionEffect,
    LawfulFriction,
    LawfulTorque,
    LoadEffect,
    PathEffect,
    ReadingEffect,
    TipEffect,
    TorqueEffect,
    with_column,
)
from gpcorrect.sim.effects.transmission_ratio import TransmissionRatio
from gpcorrect.sim.effects.viscous_friction import ViscousFriction

__all__ = [
    "EFFECTS",
    "Backlash",
    "CableCoupling",
    "CableStretch",
    "ChainEffect",
    "CoulombFriction",
    "Description",
    "Drift",
    "Effect",
    "Family",
    "Friction",
    "FrictionEffect",
    "GravitySag",
    "HomingOffset",
    "LawfulFriction",
    "LawfulTorque",
    "LoadEffect",
    "Neighbour",
    "Parameter",
    "PathEffect",
    "Range",
    "ReadingEffect",
    "Run",
    "Stage",
    "TipEffect",
    "TorqueEffect",
    "TransmissionRatio",
    "ViscousFriction",
    "effect_from_dict",
    "in_order",
    "of_kind",
    "play",
    "with_column",
]
