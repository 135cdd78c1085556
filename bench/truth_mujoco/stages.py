"""Stages behind the arm as small MuJoCo models of their own, driven by its motion and too light to act back on it.

A path is measured in units of the stage's own size, so that masses and springs are about one and MuJoCo's solver
tolerances mean the same for every joint.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray
from truth.loop import TICK_HZ

from truth_mujoco.body import FRICTION_SOLIMP, FRICTION_SOLREF, STEP

Array = NDArray[np.float64]

PER_TICK = round(1.0 / TICK_HZ / STEP)
HEAVY = 1e6  # of the driven end, whose motion is given
HOLD = 10.0  # of the inertial force at the greatest acceleration: a follower's friction, which lets nothing overrun


def _model(followers: int) -> mujoco.MjSpec:
    """Return a driven slide and followers of unit inertia on the same line."""
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.gravity = STEP, [0.0, 0.0, 0.0]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.tolerance = 1e-16  # of the heaviest, which is the driven end
    for number in range(followers + 1):
        body = spec.worldbody.add_body(name=f"body{number}")
        body.explicitinertial = True
        body.mass, body.inertia = (1.0 if number else HEAVY), np.ones(3)
        body.add_joint(name=f"slide{number}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0])
    return spec


def _driven(model: mujoco.MjModel, path: Array) -> Array:
    """Return where the followers are at the ticks `(n, f)`; they begin where the driven end begins, at rest."""
    data = mujoco.MjData(model)
    qpos, qvel = data.qpos, data.qvel
    qpos[:] = path[0]
    out = np.empty((len(path), model.nq - 1))
    speed = np.append(np.diff(path) * TICK_HZ, 0.0)
    for i, place in enumerate(path):
        qpos[0], qvel[0] = place, speed[i]
        out[i] = qpos[1:]
        mujoco.mj_step(model, data, PER_TICK)
    return out


def plays(path: Array, radii: Array) -> Array:
    """Elements that slide with dry friction, dragged by a path `(n,)` through slack of these radii.

    Each end of the slack is MuJoCo's limit of a tendon, which takes shocks without a rebound.

    Returns
    -------
    (n, f) array
        Their places.
    """
    unit = float(np.max(radii))
    x = (path - path[0]) / unit
    fastest = float(np.abs(np.diff(x, 2)).max()) * TICK_HZ**2
    spec = _model(len(radii))
    for number, radius in enumerate(radii / unit, 1):
        slack = spec.add_tendon(name=f"slack{number}", limited=1, range=[-radius, radius])
        slack.wrap_joint("slide0", 1.0)
        slack.wrap_joint(f"slide{number}", -1.0)
        slack.solref_limit, slack.solimp_limit = FRICTION_SOLREF, FRICTION_SOLIMP
        joint = spec.joint(f"slide{number}")
        joint.frictionloss = HOLD * max(fastest, 1.0)
        joint.solref_friction, joint.solimp_friction = FRICTION_SOLREF, FRICTION_SOLIMP
    return path[0] + unit * _driven(spec.compile(), x)


def ring(path: Array, frequency: float, damping_ratio: float) -> Array:
    """Mass on a spring whose other end follows a path `(n,)`, damped against the ground."""
    omega = 2 * np.pi * frequency
    unit = max(float(np.ptp(path)), 1e-12)
    spec = _model(1)
    tie = spec.add_tendon(name="tie", springlength=[0.0, 0.0])
    tie.wrap_joint("slide0", 1.0)
    tie.wrap_joint("slide1", -1.0)
    tie.stiffness = [omega**2, 0.0, 0.0]
    spec.joint("slide1").damping = [2 * damping_ratio * omega, 0.0, 0.0]
    return path[0] + unit * _driven(spec.compile(), (path - path[0]) / unit)[:, 0]


def mode(path: Array, frequency: float, damping_ratio: float) -> Array:
    """How far a mass on a damped spring swings about a foot that follows a path `(n,)`."""
    return ring(path, frequency, damping_ratio) - path


def strain(load: Array, time: Array, gain: float, seconds: float) -> Array:
    """Strain `(n,)` of a spring and a dashpot side by side under a load, from balance with the first one.

    The clock `time` (n,), s, may jump while the load stays.
    """
    spec = _model(0)
    joint = spec.joint("slide0")
    spec.body("body0").mass = 1e-3 * seconds
    joint.stiffness, joint.damping = [1.0, 0.0, 0.0], [seconds, 0.0, 0.0]
    spec.option.timestep = 1.0 / TICK_HZ
    model = spec.compile()
    data = mujoco.MjData(model)
    unit = max(float(np.abs(load).max()), 1e-12)
    data.qpos[0] = load[0] / unit
    steps = np.maximum(1, np.rint(np.diff(time, append=time[-1] + 1.0 / TICK_HZ) * TICK_HZ)).astype(int)
    out = np.empty(len(load))
    for i, force in enumerate(load / unit):
        out[i] = data.qpos[0]
        data.qfrc_applied[0] = force
        mujoco.mj_step(model, data, int(steps[i]))
    return gain * unit * out
