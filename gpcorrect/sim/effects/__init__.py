"""The catalogue of effects: a file a family, all of one form, found by themselves.

Every effect's class can be imported from here by its name; code that is type-checked imports it from its own module.
"""

from gpcorrect.sim.effects.base import (
    ChainEffect,
    DriveEffect,
    Effect,
    FrictionEffect,
    JointEffect,
    LoadEffect,
    PathEffect,
    ReadingEffect,
    Stage,
    TipEffect,
    TorqueEffect,
)
from gpcorrect.sim.effects.catalogue import (
    EFFECTS,
    Candidate,
    Scope,
    candidates,
    effect_from_dict,
    in_order,
    of_kind,
)
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.laws import FrictionLaw, TorqueLaw
from gpcorrect.sim.effects.operators import lag, play

__all__ = [
    "EFFECTS",
    "Candidate",
    "ChainEffect",
    "Description",
    "DriveEffect",
    "Effect",
    "Family",
    "FrictionEffect",
    "FrictionLaw",
    "JointEffect",
    "Ladder",
    "LoadEffect",
    "Parameter",
    "PathEffect",
    "Per",
    "Range",
    "ReadingEffect",
    "Run",
    "Scope",
    "Site",
    "Stage",
    "TipEffect",
    "TorqueEffect",
    "TorqueLaw",
    "candidates",
    "effect_from_dict",
    "in_order",
    "lag",
    "of_kind",
    "play",
]

globals().update({kind.__name__: kind for kind in EFFECTS.values()})
