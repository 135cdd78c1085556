"""Joint paths through effects, remembered joint by joint.

A change at one joint need not walk the others' paths again.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field

import numpy as np

from gpcorrect.sim.effects import Effect, PathEffect, of_kind
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray

__all__ = ["PathMemory"]

REMEMBERED_BYTES = 60_000_000


@dataclass(frozen=True, eq=False)
class PathMemory:
    """Columns of joint paths by what made them.

    Parameters
    ----------
    columns : dict
        Path `(n, N)` behind an effect, by the motion, the effect and the effects before it on its joints.
    """

    columns: dict[Hashable, FloatArray] = field(default_factory=dict, repr=False)

    def joint_path(self, effects: Sequence[Effect], motion: Motion, of_motion: Hashable) -> FloatArray:
        """Return the true joint path `(n, N, k)`, the same as `gpcorrect.sim.plant.joint_path`.

        Parameters
        ----------
        effects : sequence of Effect
            In the order in which they act.
        motion : Motion
            Of the motors.
        of_motion : hashable
            What the motion depends on.
        """
        q = motion.position
        history: list[Hashable] = [of_motion] * q.shape[-1]
        for effect in of_kind(effects, PathEffect):
            if not isinstance(effect.joint, int):
                q = effect.act(q, motion)
                history = [(effect, tuple(history))] * len(history)
                continue
            j = effect.column(motion.joints)
            made = (effect, *(history[effect.column(motion.joints, k)] for k in effect.joints))
            if made not in self.columns:
                self._forget(q)
                self.columns[made] = effect.act(q, motion)[..., j]
            history[j] = made
            changed = np.array(q)
            changed[..., j] = self.columns[made]
            q = changed
        return q

    def _forget(self, q: FloatArray) -> None:
        while len(self.columns) * q[..., 0].nbytes > REMEMBERED_BYTES:
            self.columns.pop(next(iter(self.columns)))
