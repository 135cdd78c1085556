"""Several sessions: every homing sets the joints' zeros anew."""

from __future__ import annotations

import numpy as np

from gpcorrect.arms import arm_named
from gpcorrect.sim.effects.homing_offset import HomingOffset
from gpcorrect.sim.model import Model
from gpcorrect.sim.resolve import BARE_JOINTS

__all__ = ["rehomed"]

SPREAD = {"R": np.deg2rad(0.3), "P": 5e-4}  # of a joint's zero from one homing to the next (RAVEN-II calibration paper)


def rehomed(model: Model, sessions: int, rng: np.random.Generator) -> Model:
    """Return the model with one homing offset a session on every joint: its own offset plus a new chance each time.

    One session leaves the model as it is.
    """
    if sessions == 1:
        return model
    known = {e.joint: np.atleast_1d(e.offset)[0] for e in model.effects if isinstance(e, HomingOffset)}
    others = [e for e in model.effects if not isinstance(e, HomingOffset)]
    homed = []
    for number, kind in zip(model.joints, _types(model), strict=True):
        offsets = known.get(number, 0.0) + SPREAD[kind] * rng.standard_normal(sessions)
        homed.append(HomingOffset(number, tuple(offsets.tolist())))
    return model.with_effects(*homed, *others)


def _types(model: Model) -> str:
    if model.arm == BARE_JOINTS:
        return model.joint_types or "R" * len(model.joints)
    types = arm_named(model.arm).joint_types
    return "".join(types[number - 1] for number in model.joints)
