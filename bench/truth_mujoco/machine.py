"""The machine of one case, drawn anew, and what its sensors could read of a run with causes hidden in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from truth.hidden import Hidden
from truth.history import Readings
from truth.reference import Reference

from truth_mujoco.arms import ARMS, Arm
from truth_mujoco.body import kinematics, tips
from truth_mujoco.causes import STAGES, cause_named
from truth_mujoco.motion import Run
from truth_mujoco.plant import FEEDFORWARDS, Plant, bare_plant, integrate

Array = NDArray[np.float64]

BANDWIDTH_HZ = (5.0, 9.0)
DAMPING_RATIO = (0.9, 1.2)
TILT = 0.1  # rad; standard deviation of the mounting about the usual one, known
NUISANCE = (6e-5, 8e-6, 8e-6, 6e-5)  # rad, m, m, rad; standard deviations of unknown table errors, under the noise


@dataclass(frozen=True, eq=False)
class Machine:
    """What is fixed about a case before anything is hidden in it; tool poses are only computed when `tracked`."""

    plant: Plant
    T_tracker_base: Array
    tracked: bool

    @property
    def arm(self) -> Arm:
        """Return the arm."""
        return self.plant.arm


def draw_machine(rng: np.random.Generator, name: str, *, tracked: bool, feedforward: str = "") -> Machine:
    """Draw gains, feedforward, mounting, registration and nuisance; a feedforward is drawn where none is given."""
    arm = ARMS[name]
    k, omega = arm.dof, 2 * np.pi * rng.uniform(*BANDWIDTH_HZ)
    kp = np.round(arm.motor_inertia * omega**2 * rng.uniform(0.85, 1.15, k), 3)
    kd = np.round(2 * rng.uniform(*DAMPING_RATIO, k) * np.sqrt(kp * arm.motor_inertia), 3)
    gravity = Rotation.from_rotvec(TILT * rng.standard_normal(3)).apply(arm.gravity)
    rows = arm.rows + rng.standard_normal(arm.rows.shape) * NUISANCE
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=rng).as_matrix()
    T[:3, 3] = rng.uniform(-0.5, 0.5, 3)
    drawn = FEEDFORWARDS[int(rng.integers(len(FEEDFORWARDS)))]
    return Machine(bare_plant(arm, rows, gravity, kp, kd, feedforward or drawn), T, tracked)


def simulate(
    machine: Machine, reference: Reference, torques: Array, hidden: Sequence[Hidden] = (), before: Run | None = None
) -> tuple[Run, Readings]:
    """Run a machine with its hidden causes.

    Parameters
    ----------
    machine, reference, torques, hidden :
        What runs, along what, with which nominal torques, with what.
    before : Run, optional, run of the machine without any cause, to spare a run
    """
    plant = machine.plant
    for h in hidden:
        build = cause_named(h.name).build
        if build:
            plant = build(h.params, h.column, plant)
    run = before
    if run is None or plant is not machine.plant:
        run = Run(plant, reference, integrate(plant, reference, torques))
    return run, readings_of(machine, run, hidden)


def readings_of(machine: Machine, run: Run, hidden: Sequence[Hidden]) -> Readings:
    """Return what sensors could read of a run; causes behind what MuJoCo moves do not act back on it."""
    causes = [(h, cause_named(h.name)) for h in hidden]
    q = run.recorded.link
    for h, cause in sorted(causes, key=lambda c: STAGES.index(c[0].name) if c[0].name in STAGES else -1):
        if cause.path:
            q = q - cause.path(h.params, h.column, run, q)
    T = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    if machine.tracked:
        T = tips(kinematics(machine.arm, run.plant.rows), q)
        for h, cause in causes:
            if cause.tip:
                T = cause.tip(h.params, h.column, run, T)
    readings = Readings(q, run.recorded.reported, run.recorded.command, T, np.zeros_like(q))
    for h, cause in causes:
        if cause.read:
            readings = cause.read(h.params, h.column, run, readings)
    return readings
