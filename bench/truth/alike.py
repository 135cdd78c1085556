"""What both truths do alike: numbers of causes, errors of tables, and what acts on readings and poses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truth.hidden import Params, with_column
from truth.history import Readings
from truth.loop import TICK_HZ

Array = NDArray[np.float64]

ROW_TERMS = ("alpha", "a", "d", "theta")  # the order of a row's columns
SIMILARITY = ("x", "y", "z", "rx", "ry", "rz", "scale")


def draw_similarity(rng: np.random.Generator) -> Params:
    """Return a registration that is off by parts of a millimetre, a milliradian and a thousandth."""
    sizes = np.r_[np.full(3, 2e-4), np.full(3, 1e-3), 1e-3]
    return dict(zip(SIMILARITY, (sizes * rng.standard_normal(7)).tolist(), strict=True))


def moved(params: Params, T: Array) -> Array:
    """Poses `(n, 4, 4)` as a registration that is off shows them."""
    seen = np.array(T)
    values = np.array([params[name] for name in SIMILARITY])
    R = Rotation.from_rotvec(values[3:6]).as_matrix()
    seen[:, :3, :3] = R @ T[:, :3, :3]
    seen[:, :3, 3] = (1.0 + values[6]) * T[:, :3, 3] @ R.T + values[:3]
    return seen


def draw_row(rng: np.random.Generator) -> Params:
    """Return an angle or a length between two moving joints, which neither a zero nor the registration can take up."""
    params: Params = dict.fromkeys(ROW_TERMS, 0.0)
    if rng.random() < 0.5:
        params["alpha"] = float(rng.choice([-1.0, 1.0])) * 2e-3
    else:
        params["a"] = float(rng.choice([-1.0, 1.0])) * 3e-4
    return params


def row_changed(rows: Array, j: int, params: Params) -> Array:
    """Copy of rows `(k, 4)` with one of them off."""
    changed = np.array(rows)
    changed[j] += [params[name] for name in ROW_TERMS]
    return changed


# Draws, `(rng, column, scene) -> params` of about the size of the noise; a scene is that of either truth.


def sign(rng: np.random.Generator) -> float:
    """One or minus one."""
    return float(rng.choice([-1.0, 1.0]))


def rms(values: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def draw_homing(rng: np.random.Generator, j: int, scene: Any) -> Params:
    offsets = [float(sign(rng) * rng.uniform(0.5, 1.5) * scene.noise[j]) for _ in range(scene.sessions)]
    return {"offset": offsets if scene.sessions > 1 else offsets[0]}


def draw_eccentricity(rng: np.random.Generator, j: int, scene: Any) -> Params:
    number = float(rng.uniform(*scene.unit(j, (5.0, 18.0), (80.0, 260.0))))
    return {"amplitude": float(1.4 * scene.noise[j]), "waves": number, "phase": phase(rng)}


def phase(rng: np.random.Generator) -> float:
    """Return a phase within half a turn."""
    return float(rng.uniform(-np.pi, np.pi))


def typical_stiffness(j: int, scene: Any) -> float:
    """Return that of a cable which gives way by the noise."""
    return scene.load(j) / float(scene.noise[j])


def draw_stretch(rng: np.random.Generator, j: int, scene: Any) -> Params:
    return {"stiffness": typical_stiffness(j, scene) * float(rng.uniform(0.8, 1.2))}


def draw_nonlinear(rng: np.random.Generator, j: int, scene: Any) -> Params:
    k = 0.4 * typical_stiffness(j, scene)
    return {"stiffness": k, "cubic": float(rng.uniform(1.5, 5.0)) * k / float(scene.noise[j]) ** 2}


def draw_sag(rng: np.random.Generator, j: int, scene: Any) -> Params:
    return {"stiffness": scene.weight(j) / float(scene.noise[j])}


def draw_bending(rng: np.random.Generator, j: int, scene: Any) -> Params:
    return {"rigidity": float(rng.uniform(2.0, 6.0))}


def draw_rcm(rng: np.random.Generator, j: int, scene: Any) -> Params:
    return {"stiffness": float(rng.uniform(5e3, 2e4))}


def draw_backlash(rng: np.random.Generator, j: int, scene: Any) -> Params:
    return {"radius": float(1.1 * scene.noise[j])}


def draw_coulomb(rng: np.random.Generator, j: int, scene: Any) -> Params:
    return {"torque": scene.torque(j), "side": "motor"}


def draw_viscous(rng: np.random.Generator, j: int, scene: Any) -> Params:
    return {"damping": scene.torque(j) / scene.unit(j, 0.15, 0.02), "side": "motor"}


def draw_stribeck(rng: np.random.Generator, j: int, scene: Any) -> Params:
    level = 0.8 * scene.torque(j)
    speed = float(scene.unit(j, 1.0, 0.12) * np.exp(rng.uniform(np.log(0.03), np.log(0.12))))
    return {"torque": level, "static_torque": level * float(rng.uniform(2.0, 3.5)), "speed": speed, "side": "motor"}


def draw_capstan(rng: np.random.Generator, j: int, scene: Any) -> Params:
    return {"wrap": scene.torque(j) / scene.load(j), "side": "motor"}


def draw_wavy(rng: np.random.Generator, j: int, scene: Any) -> Params:
    torque = scene.torque(j)
    return {
        "torque": torque,
        "swing": torque * float(rng.uniform(0.7, 0.98)),
        "waves": float(scene.unit(j, 1.0, 12.0) * rng.uniform(6.0, 14.0)),
        "phase": phase(rng),
        "side": "motor",
    }


def draw_creep(rng: np.random.Generator, j: int, scene: Any) -> Params:
    seconds = float(np.exp(rng.uniform(np.log(2), np.log(30))))
    return {"compliance": float(scene.noise[j]) / scene.load(j), "time_constant": seconds}


def draw_drift(rng: np.random.Generator, j: int, scene: Any) -> Params:
    whole = float(scene.reference.session_time.max())
    constant = float("inf") if rng.random() < 0.5 else whole * float(rng.uniform(0.3, 1.0))
    return {"rate": sign(rng) * 1.7 * float(scene.noise[j]) / min(whole, constant), "time_constant": constant}


def draw_delay(rng: np.random.Generator, j: int, scene: Any) -> Params:
    return {"delay": float(rng.uniform(0.002, 0.01))}


def draw_slip(rng: np.random.Generator, j: int, scene: Any) -> Params:
    """Return a step in the middle of the motion, while the joint moves."""
    reference = scene.reference
    moving = np.flatnonzero((reference.trajectory >= 0) & scene.moving(j))
    low, high = np.searchsorted(moving, [0.2 * moving[-1], 0.8 * moving[-1]])
    tick = int(rng.choice(moving[low:high]))
    return {
        "step": sign(rng) * 1.5 * float(scene.noise[j]),
        "instant": float(reference.session_time[tick]),
        "session": int(reference.session[tick]),
    }


def draw_saturation(rng: np.random.Generator, j: int, scene: Any) -> Params:
    return {"limit": float(0.97 * np.abs(scene.command(j)).max())}


def draw_stop(rng: np.random.Generator, j: int, scene: Any) -> Params:
    side, beyond = sign(rng), float(rng.uniform(0.05, 0.15))  # fraction of the samples that lie beyond
    place = float(np.quantile(scene.path(j), 1.0 - beyond if side > 0 else beyond))
    return {"stiffness": scene.stop_stiffness(j), "limit": place, "end": "upper" if side > 0 else "lower"}


def draw_resonance(rng: np.random.Generator, j: int, scene: Any) -> Params:
    return {"frequency": float(rng.uniform(7.0, 14.0)), "damping_ratio": float(rng.uniform(0.02, 0.08))}


def draw_quantisation(rng: np.random.Generator, j: int, scene: Any) -> Params:
    return {"step": float(np.sqrt(12) * scene.noise[j])}


def draw_noise(rng: np.random.Generator, j: int, scene: Any) -> Params:
    """Return a moment between two trajectories of a session, from a quarter to a half of it, of every session."""
    reference = scene.reference
    first = reference.session == 0
    number = reference.trajectory[first].max() + 1
    begins = int(rng.integers(number // 4, number // 2 + 1))
    since = reference.session_time[first & (reference.trajectory == begins)][0]
    return {"std": float(scene.noise[j]), "since": float(since)}


def draw_climbing(rng: np.random.Generator, j: int, scene: Any) -> Params:
    return {"amplitude": sign(rng) * 2.5 * float(scene.noise[j]), "source": scene.other(rng, j) + 1}


def draw_interpolation(rng: np.random.Generator, j: int, scene: Any) -> Params:
    cycles = float(scene.unit(j, 1.0, 12.0) * rng.uniform(25.0, 60.0))
    return {"amplitude": float(1.2 * scene.noise[j]), "cycles": cycles, "phase": phase(rng)}


# What acts on readings and poses, whatever moved the arm. A run has the reference that it followed.


def side_of(params: Params) -> float:
    """Return 1 for a stop at the upper end, -1 at the lower."""
    return 1.0 if params["end"] == "upper" else -1.0


def seen_late(readings: Readings, time: Array, late: Array | float) -> Readings:
    """Return what outside sensors see `late` seconds after it was so; the arm rests in a gap of the clock."""
    tip = readings.tip
    moving = tip.strides[0] > 0  # one pose broadcast over all ticks stands for no tracker
    seen = _delayed(tip.reshape(len(time), 16), time, late).reshape(tip.shape) if moving else tip
    return replace(readings, outside=_delayed(readings.outside, time, late), tip=seen)


def _delayed(values: Array, time: Array, late: Array | float) -> Array:
    return np.column_stack([np.interp(time - late, time, v) for v in values.T])


def delay(params: Params, j: int, run: Any, readings: Readings) -> Readings:
    return seen_late(readings, run.reference.time, params["delay"])


def quantised(params: Params, j: int, run: Any, readings: Readings) -> Readings:
    """Write positions down in steps; the controller works with finer ones."""
    counts = np.floor(readings.reported[:, j] / params["step"] + 0.5)
    return replace(readings, reported=with_column(readings.reported, j, counts * params["step"]))


def noisier(params: Params, j: int, run: Any, readings: Readings) -> Readings:
    """From a moment on, more noise, white and normal."""
    later = run.reference.session_time >= params["since"]
    extra = np.hypot(readings.extra_noise[:, j], np.where(later, params["std"], 0.0))
    return replace(readings, extra_noise=with_column(readings.extra_noise, j, extra))


def lateral_force(payload: Array, gravity: Array, T: Array) -> Array:
    """Part `(n, 3)` of the tip load's pull, N, across the shaft from the remote centre to the tip."""
    place = T[:, :3, 3]
    acceleration = np.gradient(np.gradient(place, axis=0), axis=0) * TICK_HZ**2
    force = payload[:, None] * (gravity - acceleration)
    shaft = place / np.linalg.norm(place, axis=1, keepdims=True)
    return force - shaft * (force * shaft).sum(axis=1, keepdims=True)


def turned(T: Array, turn: Array, shift: Array) -> Array:
    """Poses turned by small rotation vectors and shifted."""
    changed = np.array(T)
    for i in range(3):
        changed[:, :3, i] = T[:, :3, i] + np.cross(turn, T[:, :3, i])
    changed[:, :3, 3] = T[:, :3, 3] + shift
    return changed


def moments(seed: int, every: float, last: float) -> Iterator[tuple[float, np.random.Generator]]:
    """Yield random moments, s, and the generator for what happens at each."""
    rng = np.random.default_rng(seed)
    moment = float(rng.exponential(every))
    while moment < last:
        yield moment, rng
        moment += float(rng.exponential(every))
