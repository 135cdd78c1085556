"""The effects by name: adding one is its file and its line here, in the order of the catalogue."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, fields
from typing import Any, TypeVar

from gpcorrect.errors import DataError
from gpcorrect.sim.effects.backlash import Backlash
from gpcorrect.sim.effects.base import Effect
from gpcorrect.sim.effects.cable_coupling import CableCoupling
from gpcorrect.sim.effects.cable_slip import CableSlip
from gpcorrect.sim.effects.cable_stretch import CableStretch
from gpcorrect.sim.effects.capstan_friction import CapstanFriction
from gpcorrect.sim.effects.coulomb_friction import CoulombFriction
from gpcorrect.sim.effects.creep import Creep
from gpcorrect.sim.effects.delay import Delay
from gpcorrect.sim.effects.dh_error import DhError
from gpcorrect.sim.effects.drift import Drift
from gpcorrect.sim.effects.encoder_quantisation import EncoderQuantisation
from gpcorrect.sim.effects.gravity_sag import GravitySag
from gpcorrect.sim.effects.homing_offset import HomingOffset
from gpcorrect.sim.effects.hysteresis import Hysteresis
from gpcorrect.sim.effects.joint_stop import JointStop
from gpcorrect.sim.effects.length_dependent_stiffness import LengthDependentStiffness
from gpcorrect.sim.effects.noise_change import NoiseChange
from gpcorrect.sim.effects.nonlinear_stretch import NonlinearStretch
from gpcorrect.sim.effects.payload import Payload
from gpcorrect.sim.effects.position_dependent_friction import PositionDependentFriction
from gpcorrect.sim.effects.pulley_eccentricity import PulleyEccentricity
from gpcorrect.sim.effects.rcm_shift import RcmShift
from gpcorrect.sim.effects.registration_error import RegistrationError
from gpcorrect.sim.effects.resonance import Resonance
from gpcorrect.sim.effects.shaft_bending import ShaftBending
from gpcorrect.sim.effects.stribeck_friction import StribeckFriction
from gpcorrect.sim.effects.torque_saturation import TorqueSaturation
from gpcorrect.sim.effects.transmission_ratio import TransmissionRatio
from gpcorrect.sim.effects.viscous_friction import ViscousFriction

__all__ = ["EFFECTS", "effect_from_dict", "in_order", "of_kind"]

CATALOGUE: tuple[type[Effect], ...] = (
    HomingOffset,
    TransmissionRatio,
    CableCoupling,
    PulleyEccentricity,
    RegistrationError,
    DhError,
    CableStretch,
    NonlinearStretch,
    LengthDependentStiffness,
    GravitySag,
    Payload,
    ShaftBending,
    RcmShift,
    Backlash,
    CoulombFriction,
    ViscousFriction,
    StribeckFriction,
    CapstanFriction,
    PositionDependentFriction,
    Hysteresis,
    Creep,
    Drift,
    Delay,
    CableSlip,
    TorqueSaturation,
    JointStop,
    Resonance,
    EncoderQuantisation,
    NoiseChange,
)
EFFECTS: Mapping[str, type[Effect]] = {kind.about.name: kind for kind in CATALOGUE}

E = TypeVar("E", bound=Effect)


def effect_from_dict(values: Mapping[str, Any]) -> Effect:
    """Return the effect that `Effect.to_dict` wrote down.

    Raises
    ------
    DataError
        The name is not in the catalogue, a parameter is missing or no number, or the effect does not know a key.
    """
    name = values.get("name")
    if not isinstance(name, str) or name not in EFFECTS:
        raise DataError(f"no effect is called {name!r}.", hint=f"Known effects: {', '.join(EFFECTS)}.")
    kind = EFFECTS[name]
    given = {key: value for key, value in values.items() if key != "name"}
    unknown = sorted(set(given) - {f.name for f in fields(kind)})
    if unknown:
        raise DataError(f"effect {name} knows no key {', '.join(unknown)}.", hint=f"It has: {', '.join(_keys(kind))}.")
    missing = [f.name for f in fields(kind) if f.default is MISSING and f.name not in given]
    if missing:
        raise DataError(f"effect {name} lacks {', '.join(missing)}.", hint=f"It has: {', '.join(_keys(kind))}.")
    return kind(**given)


def in_order(effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """Return the effects in the order in which they act: stage, then catalogue, then joint; ties keep their order."""
    position = {kind: i for i, kind in enumerate(CATALOGUE)}
    return tuple(sorted(effects, key=lambda e: (e.stage, position.get(type(e), len(CATALOGUE)), str(e.joint))))


def of_kind(effects: Iterable[Effect], kind: Callable[..., E]) -> tuple[E, ...]:
    """Return the effects of one interface, such as :class:`~gpcorrect.sim.effects.PathEffect`, in their order."""
    assert isinstance(kind, type)  # typed as a callable because mypy takes no abstract class for a type[E]
    found: list[Any] = [e for e in effects if isinstance(e, kind)]
    return tuple(found)


def _keys(kind: type[Effect]) -> list[str]:
    return [f.name for f in fields(kind)]
