"""Machines whose logs hold poses alone, with physics of their own: nothing here is the project's simulator.

`gantry` is a carriage on cables with a head that turns about three axes: a lag of the servo, slack in all six, cables
that stretch with height, a frame that warms up. `tendons` is an arm of six joints behind tendons that rub on their way
(a spring before a slider, three in parallel), are coupled, and drag the wrist with the arm. `platform` hangs on eight
cables with slack at their pulleys and anchors that are not where they are thought to be.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal

RATE, BLEND = 50.0, 2.0  # Hz; s from one motion to the next, which no log holds
NOISE, TURN_NOISE = 1e-4, np.deg2rad(0.1)
OUTLIERS, DROPOUTS = 0.01, 12
FRAME = (Rotation.from_rotvec([0.3, -1.2, 0.8]), np.array([1.3, -0.7, 2.2]))
MARKER = (Rotation.from_rotvec([0.2, 0.5, -0.3]), np.array([0.01, 0.02, -0.04]))

Poses = tuple[FloatArray, Rotation]


def machine_log(name: str, seed: int = 0, motions: int = 40, seconds: float = 6.0) -> CalibrationLog:
    """Return a recording of one of :data:`MACHINES`: what was commanded, and what a tracker saw, with its faults."""
    rng = np.random.default_rng(seed)
    reach, act = MACHINES[name]
    asked, labels = _asked(rng, np.asarray(reach), motions, round(seconds * RATE))
    logged = labels >= 0
    position, rotation = (part[logged] for part in act(asked))
    time, asked, n = np.flatnonzero(logged) / RATE, asked[logged], int(logged.sum())
    seen, facing = _seen(position, rotation)
    seen = seen + NOISE * rng.normal(size=(n, 3))
    facing = Rotation.from_rotvec(TURN_NOISE * rng.normal(size=(n, 3))) * facing
    wild = rng.random(n) < OUTLIERS
    seen[wild] += 0.05 * rng.normal(size=(wild.sum(), 3))
    facing = Rotation.from_rotvec(0.3 * wild[:, None] * rng.normal(size=(n, 3))) * facing
    table = np.hstack([seen, _wxyz(facing)])
    for start in rng.integers(n, size=DROPOUTS):
        table[start : start + rng.integers(3, 30)] = np.nan
    return CalibrationLog(
        time=time,
        trajectory=labels[logged],
        session=np.zeros(n, dtype=np.int64),
        setpoint_cp=PoseSignal(asked[:, :3], _wxyz(Rotation.from_rotvec(asked[:, 3:]))),
        tracker_cp=PoseSignal(table[:, :3], table[:, 3:]),
        name=name,
    )


def desired(name: str, seed: int, motions: int) -> tuple[FloatArray, BoolArray, PoseSignal, PoseSignal]:
    """Return times, which rows are motions, and a path in the inner four fifths: as commands, and where they lead."""
    reach = np.asarray(MACHINES[name][0])
    path, labels = _asked(
        np.random.default_rng(seed), reach.mean(axis=0) + 0.8 * (reach - reach.mean(axis=0)), motions, 300
    )
    rotation = Rotation.from_rotvec(path[:, 3:])
    seen, facing = _seen(path[:, :3], rotation)
    told = PoseSignal(path[:, :3], _wxyz(rotation))
    return np.arange(len(path)) / RATE, labels >= 0, told, PoseSignal(seen, _wxyz(facing))


def arrived(name: str, commands: PoseSignal) -> PoseSignal:
    """Return the marker's true poses in the tracker's frame after commands; a frame that warms up is cold again."""
    assert commands.quaternion is not None
    turns = Rotation.from_quat(np.roll(commands.quaternion, -1, axis=1)).as_rotvec()
    seen, facing = _seen(*MACHINES[name][1](np.hstack([commands.position, turns])))
    return PoseSignal(seen, _wxyz(facing))


def _seen(position: FloatArray, rotation: Rotation) -> Poses:
    return FRAME[0].apply(position + rotation.apply(MARKER[1])) + FRAME[1], FRAME[0] * rotation * MARKER[0]


def _wxyz(rotation: Rotation) -> FloatArray:
    return np.asarray(np.roll(rotation.as_quat(), 1, axis=1))


def _asked(rng: np.random.Generator, reach: FloatArray, motions: int, n: int) -> tuple[FloatArray, IntArray]:
    """Return commanded paths `(m, 6)`, m and rad, one after the other, and which motion a row is of; -1 for none."""
    kinds = (_waves, _stops, _raster)
    path, labels, last = [], [], np.zeros(6)
    s = np.linspace(0.0, 1.0, round(BLEND * RATE), endpoint=False)[:, None]
    for k in range(motions):
        motion = np.clip(kinds[k % len(kinds)](rng, n), -1.0, 1.0)
        path += [last + (motion[0] - last) * _rise(s), motion]
        labels += [np.full(len(s), -1), np.full(n, k)]
        last = motion[-1]
    low, high = reach
    return (low + high) / 2 + (high - low) / 2 * np.vstack(path), np.concatenate(labels)


def _rise(s: FloatArray) -> FloatArray:
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s**2))


def _waves(rng: np.random.Generator, n: int) -> FloatArray:
    t = np.arange(n)[:, None] / RATE
    rates, phases = rng.uniform(0.1, 0.6, (3, 6)), rng.uniform(0.0, 2.0 * np.pi, (3, 6))
    return np.asarray(sum(np.sin(2.0 * np.pi * rates[k] * t + phases[k]) for k in range(3)) / 2.0)


def _stops(rng: np.random.Generator, n: int) -> FloatArray:
    ends = rng.uniform(-1.0, 1.0, (5, 6))
    s = np.linspace(0.0, 4.0 - 1e-9, n)
    leg = s.astype(int)
    return np.asarray(ends[leg] + (ends[leg + 1] - ends[leg]) * _rise(np.minimum((s - leg) / 0.8, 1.0))[:, None])


def _raster(rng: np.random.Generator, n: int) -> FloatArray:
    s, middle = np.linspace(0.0, 4.0, n)[:, None], rng.uniform(-0.3, 0.3, 6)
    across = 4.0 * np.abs((s + rng.random(6)) % 1.0 - 0.5) - 1.0
    return np.asarray(middle + np.where(rng.random(6) < 0.5, 0.6 * across, 0.3 * (s - 2.0)))


def slack(path: FloatArray, radius: FloatArray) -> FloatArray:
    """Return what a path `(n, d)` drags behind it at slacks of half widths `radius` `(d,)`."""
    dragged = path.copy()
    for i in range(1, len(path)):
        dragged[i] = np.clip(dragged[i - 1], path[i] - radius, path[i] + radius)
    return dragged


def late(path: FloatArray, constant: float) -> FloatArray:
    """Return a path `(n, d)` behind a servo of first order, s."""
    a = 1.0 - np.exp(-1.0 / (RATE * constant))
    return np.asarray(lfilter([a], [1.0, a - 1.0], path - path[0], axis=0) + path[0])


def _gantry(asked: FloatArray) -> Poses:
    moved = slack(late(asked, 0.04), np.array([8e-4, 8e-4, 4e-4, 0.008, 0.012, 0.016]))
    moved[:, 2] += 0.02 * moved[:, 2] ** 2 - 0.004 * np.abs(moved[:, 0])
    moved[:, 4] += 0.03 * moved[:, 0]
    warm = 1.0 - np.exp(-np.arange(len(asked))[:, None] / (RATE * 150.0))
    moved = moved + warm * np.array([1e-3, -5e-4, 1.5e-3, 0.0, 0.004, 0.0])
    return moved[:, :3], Rotation.from_rotvec(moved[:, 3:])


def _tendons(asked: FloatArray) -> Poses:
    """Pan, tilt and reach, then three turns of the wrist, found back from the pose asked for."""
    x, y, z = asked[:, :3].T
    length = np.linalg.norm(asked[:, :3], axis=1)
    pan, tilt = np.arctan2(y, x), np.arcsin(z / length)
    wrist = Rotation.from_euler("ZY", np.column_stack([pan, -tilt])).inv() * Rotation.from_rotvec(asked[:, 3:])
    joints = np.column_stack([pan, tilt, length, wrist.as_euler("XYZ")])
    joints = late(joints, 0.05)
    widths = np.array([0.006, 0.006, 0.001, 0.02, 0.02, 0.03])
    moved = sum(share * slack(joints, width * widths) for share, width in ((0.5, 0.4), (0.3, 1.0), (0.2, 2.5)))
    moved[:, 3:] += np.column_stack([0.03 * moved[:, 0], -0.05 * moved[:, 1], 0.04 * (moved[:, 0] + moved[:, 4])])
    moved[:, :3] *= [1.01, 0.99, 1.004]
    pan, tilt, length = moved[:, :3].T
    position = length[:, None] * np.column_stack([np.cos(tilt) * np.cos(pan), np.cos(tilt) * np.sin(pan), np.sin(tilt)])
    arm = Rotation.from_euler("ZY", np.column_stack([pan, -tilt]))
    return position, arm * Rotation.from_euler("XYZ", moved[:, 3:])


def _platform(asked: FloatArray) -> Poses:
    """Cables from eight corners to a small box; what their lengths are off by moves it by least squares."""
    rng = np.random.default_rng(11)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    anchors = corners * [1.0, 0.9, 0.8]
    ties = Rotation.from_euler("z", 50, degrees=True).apply(corners * [0.18, 0.15, -0.12])
    real_anchors, real_ties = anchors + 0.005 * rng.normal(size=(8, 3)), ties + 0.002 * rng.normal(size=(8, 3))
    position, rotation = late(asked, 0.06), None
    position, rotation = position[:, :3], Rotation.from_rotvec(position[:, 3:])
    lengths, _ = _cables(position, rotation, anchors, ties)
    pulled = slack(lengths, 0.0015 + 0.001 * rng.random(8)) * (1.0 + 0.003 * rng.normal(size=8))
    for _ in range(3):
        found, jacobian = _cables(position, rotation, real_anchors, real_ties)
        step = np.einsum("nij,nj->ni", np.linalg.pinv(jacobian), pulled - found)
        position, rotation = position + step[:, :3], Rotation.from_rotvec(step[:, 3:]) * rotation
    return position, rotation


def _cables(position: FloatArray, rotation: Rotation, anchors: FloatArray, ties: FloatArray) -> tuple[FloatArray, ...]:
    """Return lengths `(n, 8)` and their slopes by shifts and turns of the box `(n, 8, 6)`."""
    arms = np.einsum("nij,kj->nki", rotation.as_matrix(), ties)
    along = position[:, None] + arms - anchors
    length = np.linalg.norm(along, axis=2)
    unit = along / length[:, :, None]
    return length, np.concatenate([unit, np.cross(arms, unit)], axis=2)


MACHINES: dict[str, tuple[tuple[list[float], list[float]], Callable[[FloatArray], Poses]]] = {
    "gantry": (([-0.2, -0.2, -0.1, -0.5, -0.5, -0.8], [0.2, 0.2, 0.1, 0.5, 0.5, 0.8]), _gantry),
    "tendons": (([0.2, -0.15, -0.12, -0.6, -0.5, -0.6], [0.4, 0.15, 0.12, 0.6, 0.5, 0.6]), _tendons),
    "platform": (([-0.4, -0.35, -0.25, -0.2, -0.2, -0.2], [0.4, 0.35, 0.25, 0.2, 0.2, 0.2]), _platform),
}
