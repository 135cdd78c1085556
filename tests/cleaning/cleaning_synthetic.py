"""Calibration logs with a known truth: smooth reaches, a systematic residual field, hysteresis, noise, faults."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from gpcorrect.sim.effects import play
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal

WORKSPACE = np.array([0.08, 0.08, 0.02])  # Mahler et al. 2014, Sec. V: 8 x 8 x 2 cm
SPEED = 0.05
RATE = 100.0


@dataclass(frozen=True)
class World:
    """How the robot of a test misses: amplitudes in m and rad."""

    reaches: int = 60
    field_m: float = 0.01
    field_rad: float = np.radians(8)
    viscous_s: float = 0.03
    play_m: float = 0.001
    play_rad: float = np.radians(1.0)
    noise_m: float = 2e-4
    noise_rad: float = np.radians(0.2)
    tilt_rad: float = np.radians(25)
    rate: float = RATE
    position_only: bool = False


def reaching_command(world: World, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, IntArray]:
    """Minimum-jerk reaches between random targets, a trajectory each, no pauses: position, rotvec, trajectory."""
    targets = (rng.random((world.reaches + 1, 3)) - 0.5) * WORKSPACE
    tilts = world.tilt_rad * rng.uniform(-1, 1, (world.reaches + 1, 3))
    positions, rotvecs, labels = [], [], []
    for k in range(world.reaches):
        duration = max(0.3, 1.875 * float(np.linalg.norm(targets[k + 1] - targets[k])) / SPEED / 1.5)
        s = np.linspace(0, 1, max(8, round(duration * world.rate)), endpoint=False)[:, None]
        blend = 10 * s**3 - 15 * s**4 + 6 * s**5
        positions.append(targets[k] + blend * (targets[k + 1] - targets[k]))
        rotvecs.append(tilts[k] + blend * (tilts[k + 1] - tilts[k]))
        labels.append(np.full(len(s), k))
    return np.concatenate(positions), np.concatenate(rotvecs), np.concatenate(labels)


def smooth_field(inputs: FloatArray, rng: np.random.Generator, waves: int = 6) -> FloatArray:
    """Three outputs of unit maximal norm: sums of random sinusoids over inputs of unit size."""
    omega = rng.normal(0, 1.5, (waves, inputs.shape[1], 3))
    phase = rng.uniform(0, 2 * np.pi, (waves, 3))
    values = np.sin(np.einsum("nd,wdk->nwk", inputs, omega) + phase).sum(axis=1)
    values -= values.mean(axis=0)
    return values / np.linalg.norm(values, axis=1).max()


def make_log(world: World, rng: np.random.Generator) -> CalibrationLog:
    """Make a fault-free log: the command moved by field, viscous lag, play and noise, in an arbitrary tracker frame."""
    position, rotvec, trajectory = reaching_command(world, rng)
    time = np.arange(len(position)) / world.rate
    velocity = np.gradient(position, time, axis=0)
    inputs = np.hstack([position / 0.04, rotvec / world.tilt_rad, 0.5 * velocity / SPEED])
    lost, unturned = position - play(position, world.play_m), rotvec - play(rotvec, world.play_rad)
    shift = world.field_m * smooth_field(inputs, rng) + world.viscous_s * velocity + lost
    turn = world.field_rad * smooth_field(inputs, rng) + unturned
    base = np.array([0.1, -0.02, -0.15])
    R_command = Rotation.from_rotvec(rotvec) * Rotation.from_euler("y", 90, degrees=True)
    seen = position + base - shift + world.noise_m * rng.normal(size=position.shape)
    R_seen = Rotation.from_rotvec(-turn + world.noise_rad * rng.normal(size=turn.shape)) * R_command
    R_frame, t_frame = Rotation.random(random_state=int(rng.integers(2**31))), rng.uniform(-1, 1, 3)
    tracker = PoseSignal(R_frame.apply(seen) + t_frame, (R_frame * R_seen).as_quat(scalar_first=True))
    command = PoseSignal(position + base, R_command.as_quat(scalar_first=True))
    if world.position_only:
        tracker = PoseSignal(tracker.position)
    session = np.zeros(len(time), dtype=np.int64)
    return CalibrationLog(time, trajectory, session, setpoint_cp=command, tracker_cp=tracker)


def random_directions(n: int, rng: np.random.Generator) -> FloatArray:
    """Draw unit vectors (n, 3), uniform on the sphere."""
    vectors = rng.normal(size=(n, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _moved(log: CalibrationLog, rows: IntArray, shift: FloatArray, turn: FloatArray) -> CalibrationLog:
    poses = log.tracker_cp
    assert poses is not None
    position = np.array(poses.position)
    position[rows] += shift
    quaternion = poses.quaternion
    if quaternion is not None:
        quaternion = np.array(quaternion)
        turned = Rotation.from_rotvec(turn) * Rotation.from_quat(quaternion[rows], scalar_first=True)
        quaternion[rows] = turned.as_quat(scalar_first=True)
    return replace(log, tracker_cp=PoseSignal(position, quaternion))


def _taken(log: CalibrationLog, rows: IntArray, source: IntArray) -> CalibrationLog:
    poses = log.tracker_cp
    assert poses is not None
    index = np.arange(len(log))
    index[rows] = source
    return replace(log, tracker_cp=poses[index])


def _mask(n: int, rows: IntArray) -> BoolArray:
    mask = np.zeros(n, dtype=bool)
    mask[rows] = True
    return mask


Faulty = tuple[CalibrationLog, BoolArray]


def scattered(log: CalibrationLog, rng: np.random.Generator, share: float = 0.05) -> Faulty:
    """Gross outliers at single samples: 1 to 20 cm and up to 60 degrees."""
    rows = rng.choice(len(log), max(1, int(share * len(log))), replace=False)
    shift = random_directions(len(rows), rng) * rng.uniform(0.01, 0.2, (len(rows), 1))
    turn = random_directions(len(rows), rng) * rng.uniform(0, np.radians(60), (len(rows), 1))
    return _moved(log, rows, shift, turn), _mask(len(log), rows)


def _block_rows(log: CalibrationLog, rng: np.random.Generator, share: float, late: bool = False) -> IntArray:
    n = len(log)
    length = max(3, int(share * n))
    start = int(rng.integers(int(0.82 * n) if late else 0, n - length))
    return np.arange(start, start + length)


def offset_block(log: CalibrationLog, rng: np.random.Generator, share: float = 0.03, late: bool = False) -> Faulty:
    """Shift one long block by 1 to 5 cm and turn it by 5 to 40 degrees: a lost fiducial."""
    rows = _block_rows(log, rng, share, late)
    shift = random_directions(1, rng) * rng.uniform(0.01, 0.05)
    turn = random_directions(1, rng) * rng.uniform(np.radians(5), np.radians(40))
    return _moved(log, rows, np.repeat(shift, len(rows), 0), np.repeat(turn, len(rows), 0)), _mask(len(log), rows)


def held_out_block(log: CalibrationLog, rng: np.random.Generator) -> Faulty:
    """Lose a fiducial in the last fifth of the recording."""
    return offset_block(log, rng, late=True)


def small_offset_block(log: CalibrationLog, rng: np.random.Generator, share: float = 0.03) -> Faulty:
    """Shift a block by 1 cm, not turned: the hardest lost fiducial."""
    rows = _block_rows(log, rng, share)
    shift = 0.01 * random_directions(1, rng)
    return _moved(log, rows, np.repeat(shift, len(rows), 0), np.zeros((len(rows), 3))), _mask(len(log), rows)


def whole_trajectories(log: CalibrationLog, rng: np.random.Generator, count: int = 2) -> Faulty:
    """Consecutive whole trajectories are shifted by 1 to 5 cm and turned by 5 to 40 degrees."""
    ids = log.trajectory_ids
    first = int(rng.integers(0, len(ids) - count + 1))
    rows = np.flatnonzero(np.isin(log.trajectory, ids[first : first + count]))
    shift = random_directions(1, rng) * rng.uniform(0.01, 0.05)
    turn = random_directions(1, rng) * rng.uniform(np.radians(5), np.radians(40))
    return _moved(log, rows, np.repeat(shift, len(rows), 0), np.repeat(turn, len(rows), 0)), _mask(len(log), rows)


def frozen_block(log: CalibrationLog, rng: np.random.Generator, share: float = 0.03) -> Faulty:
    """Let the tracker repeat its last value through one long block."""
    rows = _block_rows(log, rng, share)
    rows = rows[rows > 0]
    return _taken(log, rows, np.full(len(rows), rows[0] - 1)), _mask(len(log), rows)


def wandering_block(log: CalibrationLog, rng: np.random.Generator, share: float = 0.03) -> Faulty:
    """Take the marker for another body 2 to 5 cm away that wanders on its own."""
    rows = _block_rows(log, rng, share)
    phase = rng.uniform(0, 2 * np.pi, 3) + np.outer(np.arange(len(rows)) / RATE, rng.uniform(0.5, 3, 3))
    shift = random_directions(1, rng) * rng.uniform(0.02, 0.05) + 0.005 * np.sin(phase)
    turn = np.repeat(random_directions(1, rng) * rng.uniform(np.radians(10), np.radians(40)), len(rows), 0)
    return _moved(log, rows, shift, turn), _mask(len(log), rows)


def occlusion_jumps(log: CalibrationLog, rng: np.random.Generator, share: float = 0.04) -> Faulty:
    """Position steps of 4 to 20 mm that last 3 to 30 samples."""
    n, faulty = len(log), np.zeros(len(log), dtype=bool)
    while faulty.sum() < share * n:
        start, length = int(rng.integers(0, n - 30)), int(rng.integers(3, 31))
        free = not faulty[max(0, start - 10) : start + length + 10].any()
        if not free or log.trajectory[start] != log.trajectory[start + length - 1]:
            continue
        rows = np.arange(start, start + length)
        shift = random_directions(1, rng) * rng.uniform(0.004, 0.02)
        log = _moved(log, rows, np.repeat(shift, length, 0), np.zeros((length, 3)))
        faulty[rows] = True
    return log, faulty


def flipped(log: CalibrationLog, rng: np.random.Generator, share: float = 0.04) -> Faulty:
    """Flip orientations by 90 or 180 degrees about a body axis at runs of 1 to 40 samples; positions stay true."""
    faulty = np.zeros(len(log), dtype=bool)
    while faulty.sum() < share * len(log):
        start = int(rng.integers(0, len(log) - 40))
        rows = np.arange(start, start + int(rng.integers(1, 41)))
        rows = rows[~faulty[rows]]
        turn = np.eye(3)[rng.integers(3)] * rng.choice([np.pi / 2, np.pi])
        log = _moved(log, rows, np.zeros((len(rows), 3)), np.repeat(turn[None], len(rows), 0))
        faulty[rows] = True
    return log, faulty


def shuffled(log: CalibrationLog, rng: np.random.Generator, share: float = 0.04) -> Faulty:
    """Swap samples in time inside windows of a second; faulty are those moved by more than 3 mm or 3 degrees."""
    before = log.tracker_cp
    assert before is not None
    window = round(RATE)
    for start in rng.choice(len(log) - window, max(1, int(share * len(log) / window)), replace=False):
        rows = np.arange(start, start + window)
        log = _taken(log, rows, rng.permutation(rows))
    after = log.tracker_cp
    assert after is not None
    moved = np.linalg.norm(after.position - before.position, axis=1) > 0.003
    if after.quaternion is not None:
        o, c = (Rotation.from_quat(s.quaternion, scalar_first=True) for s in (before, after))
        moved |= (o * c.inv()).magnitude() > np.radians(3)
    return log, moved


FAULTS: dict[str, Callable[[CalibrationLog, np.random.Generator], Faulty]] = {
    "scattered": scattered,
    "offset block": offset_block,
    "held-out block": held_out_block,
    "1 cm offset block": small_offset_block,
    "whole trajectories": whole_trajectories,
    "frozen block": frozen_block,
    "wandering block": wandering_block,
    "occlusion jumps": occlusion_jumps,
    "flipped orientation": flipped,
    "shuffled in time": shuffled,
}
