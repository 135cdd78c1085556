"""The catalogue of effects: one file each, all of one form."""

from gpcorrect.sim.effects.backlash import Backlash
from gpcorrect.sim.effects.base import Effect, Stage
from gpcorrect.sim.effects.cable_coupling import CableCoupling
from gpcorrect.sim.effects.cable_slip import CableSlip
from gpcorrect.sim.effects.cable_stretch import CableStretch
from gpcorrect.sim.effects.candidates import Candidate, Scope, candidates
from gpcorrect.sim.effects.capstan_friction import CapstanFriction
from gpcorrect.sim.effects.coulomb_friction import CoulombFriction
from gpcorrect.sim.effects.creep import Creep
from gpcorrect.sim.effects.delay import Delay
from gpcorrect.sim.effects.description import Description, Family, Ladder, Neighbour, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.dh_error import DhError
from gpcorrect.sim.effects.drift import Drift
from gpcorrect.sim.effects.encoder_quantisation import EncoderQuantisation
from gpcorrect.sim.effects.gravity_sag import GravitySag
from gpcorrect.sim.effects.homing_offset import HomingOffset
from gpcorrect.sim.effects.hysteresis import Hysteresis
from gpcorrect.sim.effects.joint_stop import JointStop
from gpcorrect.sim.effects.laws import FrictionLaw, TorqueLaw
from gpcorrect.sim.effects.length_dependent_stiffness import LengthDependentStiffness
from gpcorrect.sim.effects.noise_change import NoiseChange
from gpcorrect.sim.effects.nonlinear_stretch import NonlinearStretch
from gpcorrect.sim.effects.operators import bouc_wen, lag, play, ring
from gpcorrect.sim.effects.payload import Payload
from gpcorrect.sim.effects.position_dependent_friction import PositionDependentFriction
from gpcorrect.sim.effects.pulley_eccentricity import PulleyEccentricity
from gpcorrect.sim.effects.rcm_shift import RcmShift
from gpcorrect.sim.effects.registration_error import RegistrationError
from gpcorrect.sim.effects.registry import EFFECTS, effect_from_dict, in_order, of_kind
from gpcorrect.sim.effects.resonance import Resonance
from gpcorrect.sim.effects.shaft_bending import ShaftBending
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
from gpcorrect.sim.effects.stribeck_friction import StribeckFriction
from gpcorrect.sim.effects.torque_saturation import TorqueSaturation
from gpcorrect.sim.effects.transmission_ratio import TransmissionRatio
from gpcorrect.sim.effects.viscous_friction import ViscousFriction

__all__ = [
    "EFFECTS",
    "Backlash",
    "CableCoupling",
    "CableSlip",
    "CableStretch",
    "Candidate",
    "CapstanFriction",
    "ChainEffect",
    "CoulombFriction",
    "Creep",
    "Delay",
    "Description",
    "DhError",
    "Drift",
    "Effect",
    "EncoderQuantisation",
    "Family",
    "Friction",
    "FrictionEffect",
    "FrictionLaw",
    "GravitySag",
    "HomingOffset",
    "Hysteresis",
    "JointStop",
    "Ladder",
    "LawfulFriction",
    "LawfulTorque",
    "LengthDependentStiffness",
    "LoadEffect",
    "Neighbour",
    "NoiseChange",
    "NonlinearStretch",
    "Parameter",
    "PathEffect",
    "Payload",
    "Per",
    "PositionDependentFriction",
    "PulleyEccentricity",
    "Range",
    "RcmShift",
    "ReadingEffect",
    "RegistrationError",
    "Resonance",
    "Run",
    "Scope",
    "ShaftBending",
    "Site",
    "Stage",
    "StribeckFriction",
    "TipEffect",
    "TorqueEffect",
    "TorqueLaw",
    "TorqueSaturation",
    "TransmissionRatio",
    "ViscousFriction",
    "bouc_wen",
    "candidates",
    "effect_from_dict",
    "in_order",
    "lag",
    "of_kind",
    "play",
    "ring",
    "with_column",
]
