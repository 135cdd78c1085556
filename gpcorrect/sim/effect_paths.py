"""Through the effects: from the path of motors to that of joints and tool, and from the load on joints to motors."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gpcorrect.sim.effects import Effect, JointEffect, PathEffect, TipEffect, of_kind
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray


@dataclass(frozen=True, eq=False)
class Column:
    """A joint's path `(n, N)` behind some effects, by which what was computed from it is known again."""

    path: FloatArray

    @property
    def nbytes(self) -> int:
        """Bytes of it."""
        return self.path.nbytes


class Known(Protocol):
    """What remembers columns by keys."""

    def get(self, key: Hashable) -> Column | None:
        """Return what is remembered."""

    def keep(self, key: Hashable, value: Column) -> Column:
        """Remember a column, and return it."""


def through(effects: Sequence[Effect], q: FloatArray, motion: Motion) -> FloatArray:
    """Return a joint path `(n, N, dof)` behind the effects.

    Parameters
    ----------
    effects : sequence of Effect, in the order in which they act
    q : (n, N, dof) array, the path before them
    motion : Motion
    """
    for effect in of_kind(effects, PathEffect):
        q = effect.act(q, motion)
    return q


def joint_path(
    effects: Sequence[Effect], motion: Motion, known: Known | None = None, of: Hashable = None
) -> FloatArray:
    """Return the true joint path `(n, N, dof)`: the reported motor path through every effect up to the link.

    Parameters
    ----------
    effects : sequence of Effect, in the order in which they act
    motion : Motion
    known : Known, optional
        What was computed before: of two sets that differ in one effect, the joints that it does not concern.
    of : hashable, what tells this motion from others of which `known` has columns
    """
    if known is None:
        return through(effects, motion.position, motion)
    q, before = np.array(motion.position), list[Hashable](motion.joints)
    for effect in of_kind(effects, PathEffect):
        if not isinstance(effect, JointEffect) or not isinstance(effect.joint, int):
            q, before = np.array(effect.act(q, motion)), [object() for _ in before]
            continue
        key = (of, effect, *(before[effect.column(motion.joints, joint)] for joint in effect.joints))
        if (column := known.get(key)) is None:
            column = known.keep(key, Column(np.array(effect.own_path(q, motion))))
        j = effect.column(motion.joints)
        q[..., j], before[j] = column.path, column
    return q


def tip_path(effects: Sequence[Effect], T_base_tip: FloatArray | None, motion: Motion) -> FloatArray | None:
    """Return the true tool poses `(n, N, 4, 4)`: the kinematics' poses through the effects at tool and base.

    Parameters
    ----------
    effects : sequence of Effect, in the order in which they act
    T_base_tip : (n, N, 4, 4) array or None, poses of the kinematics
    motion : Motion
    """
    if T_base_tip is None:
        return None
    for effect in of_kind(effects, TipEffect):
        T_base_tip = effect.act(T_base_tip, motion)
    return T_base_tip


def load_on_motors(effects: Sequence[Effect], load: FloatArray, joints: tuple[int, ...]) -> FloatArray:
    """Return the load `(..., dof)` that motors feel of the one at the joints, from the last effect to the first.

    Parameters
    ----------
    effects : sequence of Effect, in the order in which they act on the path
    load : (..., dof) array
    joints : tuple of int, joint numbers of its columns
    """
    for effect in reversed(of_kind(effects, PathEffect)):
        load = effect.on_motors(load, joints)
    return load
