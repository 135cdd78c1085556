"""What a residual may depend on: variables of every row, from the motor side only, so that no truth leaks into them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.discrepancy.recording.scene import Scene
from gpcorrect.types import FloatArray, IntArray

__all__ = ["Covariates", "covariates_of", "since_reversal", "travel_direction"]

RESOLUTION = 1e-3  # of the joint's travel: smaller moves do not turn the direction


@dataclass(frozen=True, eq=False)
class Covariates:
    """Variables by name for one joint's channel.

    Parameters
    ----------
    values : dict of str to (n,) array
        Variables; those that do not vary are left out.
    primary : tuple of str
        Those that are tested together with every other one.
    units : dict of str to str
        SI units of the variables that have one.
    """

    values: dict[str, FloatArray]
    primary: tuple[str, ...]
    units: dict[str, str]


def travel_direction(path: FloatArray, run: IntArray) -> FloatArray:
    """Direction `(n,)` of the last move larger than the resolution, -1 or 1; 0 before the first one of a run."""
    threshold = RESOLUTION * float(np.ptp(path))
    direction = np.zeros(len(path))
    for k in np.unique(run):
        rows = np.flatnonzero(run == k)
        anchor, current = path[rows[0]], 0.0
        for row in rows:
            if abs(path[row] - anchor) > threshold:
                current = float(np.sign(path[row] - anchor))
                anchor = path[row]
            elif current * (path[row] - anchor) > 0:
                anchor = path[row]
            direction[row] = current
    return direction


def since_reversal(
    time: FloatArray, path: FloatArray, direction: FloatArray, run: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Seconds `(n,)` and way `(n,)` since the last reversal (or start) of each run."""
    turned = np.r_[True, (direction[1:] != direction[:-1]) | (run[1:] != run[:-1])]
    last = np.maximum.accumulate(np.where(turned, np.arange(len(path)), 0))
    return time - time[last], np.abs(path - path[last])


def covariates_of(scene: Scene, joint_index: int | None) -> Covariates:
    """Variables for a channel of the joint in this column; None for a channel that speaks of all joints."""
    motor = scene.motor_path()
    label = scene.run_of_row()
    values: dict[str, FloatArray] = {}
    primary: list[str] = []
    columns = range(len(scene.joints)) if joint_index is None else [joint_index]
    speed = scene.layout.gather(scene.motion.velocity, len(scene))
    load = scene.load()
    for j in columns:
        tag = scene.joints[j]
        direction = travel_direction(motor[:, j], label)
        since, way = since_reversal(scene.time, motor[:, j], direction, label)
        values |= {f"position {tag}": motor[:, j], f"direction {tag}": direction, f"speed {tag}": np.abs(speed[:, j])}
        values |= {f"time since reversal {tag}": since, f"way since reversal {tag}": direction * way}
        values[f"acceleration {tag}"] = _acceleration(scene.time, speed[:, j], label)
        values[f"load {tag}"] = load[:, j]
        if scene.effort is not None:
            values[f"effort {tag}"] = scene.effort[:, j]
        primary += [f"position {tag}", f"direction {tag}"]
    for k, number in enumerate(scene.joints):
        if k not in columns:
            values[f"position {number}"] = motor[:, k]
            values[f"direction {number}"] = travel_direction(motor[:, k], label)
    values |= _times(scene)
    kept = {name: v for name, v in values.items() if np.nanstd(v) > 0}
    units = {name: _unit(name, scene) for name in kept}
    return Covariates(kept, tuple(p for p in primary if p in kept), units)


def _unit(name: str, scene: Scene) -> str:
    """SI unit of a variable: that of its joint, of its kind."""
    kind, _, number = name.rpartition(" ")
    if name == "session" or kind == "direction":
        return ""
    if name in ("time in trajectory", "session time") or kind == "time since reversal":
        return "s"
    slides = scene.machine.body.types[scene.joints.index(int(number))] == "P"
    length, force = ("m", "N") if slides else ("rad", "N m")
    rates = {"speed": f"{length}/s", "acceleration": f"{length}/s^2", "load": force, "effort": force}
    return rates.get(kind, length)


def _acceleration(time: FloatArray, speed: FloatArray, run: IntArray) -> FloatArray:
    change = np.zeros(len(time))
    inside = run[1:] == run[:-1]
    step = np.diff(time)
    change[1:] = np.where(inside & (step > 0), np.diff(speed) / np.where(step > 0, step, 1.0), 0.0)
    return change


def _times(scene: Scene) -> dict[str, FloatArray]:
    first = np.r_[True, scene.trajectory[1:] != scene.trajectory[:-1]]
    start = np.maximum.accumulate(np.where(first, np.arange(len(scene)), 0))
    clock = scene.layout.gather(scene.motion.time, len(scene))
    values = {"time in trajectory": scene.time - scene.time[start], "session time": clock}
    if scene.n_sessions > 1:
        values["session"] = scene.session.astype(np.float64)
    return values
