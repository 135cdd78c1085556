"""One run of a machine: what MuJoCo recorded, and what follows from it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray
from truth.loop import TICK_HZ
from truth.reference import Reference

from truth_mujoco.body import PAYLOAD, kinematics
from truth_mujoco.plant import Plant, Recorded

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Run:
    """A plant, its reference, and the motion that followed."""

    plant: Plant
    reference: Reference
    recorded: Recorded

    @cached_property
    def speed(self) -> Array:
        """Links' speed `(n, k)` at the ticks."""
        return np.gradient(self.recorded.link, 1.0 / TICK_HZ, axis=0)

    @cached_property
    def _loads(self) -> tuple[Array, Array]:
        q, v = self.recorded.link, self.speed
        a = np.gradient(v, 1.0 / TICK_HZ, axis=0)
        model = kinematics(self.plant.arm, self.plant.rows)
        model.opt.gravity[:] = self.plant.gravity
        data, body, mass = mujoco.MjData(model), model.body(PAYLOAD).id, np.nan
        total, weight = np.empty_like(q), np.empty_like(q)
        for t in range(len(q)):
            if self.reference.payload[t] != mass:
                mass = self.reference.payload[t]
                model.body_mass[body] = mass + self.plant.hidden_mass
                mujoco.mj_setConst(model, data)
            data.qpos[:], data.qvel[:], data.qacc[:] = q[t], v[t], a[t]
            mujoco.mj_inverse(model, data)
            total[t] = data.qfrc_inverse
            data.qvel[:], data.qacc[:] = 0.0, 0.0
            mujoco.mj_inverse(model, data)
            weight[t] = data.qfrc_inverse
        return total, weight

    @property
    def load(self) -> Array:
        """Torque `(n, k)` that the links ask of the joints at the ticks, by MuJoCo's inverse dynamics."""
        return self._loads[0]

    @property
    def weight(self) -> Array:
        """The part of it that holds the links up."""
        return self._loads[1]
