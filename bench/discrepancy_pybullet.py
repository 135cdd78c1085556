"""The workflow on an arm that a third engine moves: an iiwa of PyBullet under its own controller, effects hidden.

    pip install pybullet
    python bench/discrepancy_pybullet.py [--cases nothing,coulomb --motions 8 --seconds 8]

Nothing of the project makes the recordings: PyBullet integrates the links, in 16 steps to each of the controller's
(`--steps`), its inverse dynamics hold the arm up, and what is hidden is a number of PyBullet's own or a torque written
here.
"""

from __future__ import annotations

import argparse
import re
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from engine_cases import Question, ask, on, stamps, waves
from support import print_load

from gpcorrect.sim import Model, model_from_dict
from gpcorrect.types import CalibrationLog, FloatArray

try:
    import pybullet
    import pybullet_data
except ImportError:
    raise SystemExit("skipped: PyBullet is not installed (pip install pybullet)") from None

KP = np.array([800.0, 800.0, 300.0, 300.0, 60.0, 50.0, 12.0])
KD = np.array([50.0, 50.0, 16.0, 16.0, 2.0, 1.6, 0.3])
HOME = np.array([0.0, 0.8, 0.0, -1.3, 0.0, 0.8, 0.0])
REACH = np.array([1.0, 0.6, 1.0, 0.7, 1.0, 0.8, 1.3])  # of the desired waves, joint by joint
RATE_HZ, LOG_HZ, BRAKE = 1000, 50, 0.002  # BRAKE: rad/s at which dry friction has most of its torque
ENCODER, OUTSIDE = 2e-5, 1e-4  # rad, white noise of motor encoders and outside ones
Law = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]


def nothing(q: FloatArray, v: FloatArray, torque: FloatArray) -> FloatArray:
    """No torque, and no joint away from its motor."""
    return np.zeros(len(q))


@dataclass(frozen=True)
class Case:
    """What is hidden: links heavier by kg, a controller's gains and feedforward by fractions, torques, and ways out."""

    name: str  # of the catalogue; empty where nothing, or nothing of it, is hidden
    joint: int | None = None
    heavier: tuple[int, float] | None = None
    stiffer: FloatArray = field(default_factory=lambda: np.zeros(7))
    fed: FloatArray = field(default_factory=lambda: np.ones(7))
    torque: Law = nothing  # of friction and the like, on each joint
    away: Law = nothing  # from motor to joint


# Away from its motor is joint 1 alone, whose axis is upright: PyBullet's arm does not follow, and weight would tell.
CASES = {
    "nothing": Case(""),
    "coulomb": Case("coulomb_friction", 2, torque=lambda q, v, tau: on(2, -4.0 * np.tanh(v / BRAKE))),
    "viscous": Case("viscous_friction", 3, torque=lambda q, v, tau: on(3, -3.0 * v)),
    "heavy": Case("link_mass_error", 4, heavier=(4, 1.0)),
    "gain": Case("gain_error", 2, stiffer=on(2, np.full(7, -0.2))),
    "gravity": Case("feedforward_error", 4, fed=1.0 + on(4, np.full(7, -0.3))),
    "ratio": Case("transmission_ratio", 1, away=lambda q, v, tau: on(1, 0.01 * (q - HOME))),
    "cogging": Case("?", 2, torque=lambda q, v, tau: on(2, 4.0 * np.sin(24.0 * q))),
    "load friction": Case(
        "capstan_friction", 2, torque=lambda q, v, tau: on(2, -0.08 * np.abs(tau) * np.tanh(v / BRAKE))
    ),
    "cross talk": Case(
        "?", 1, away=lambda q, v, tau: on(1, 0.003 * np.tanh(3.0 * q[1]) * np.sin(2.0 * q[5]) * np.ones(7))
    ),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", default=",".join(CASES), help="names, separated by commas")
    parser.add_argument("--motions", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=16, help="of PyBullet's to one of the controller's")
    options = parser.parse_args()
    print_load()
    with tempfile.TemporaryDirectory() as folder:
        ask("discrepancy_pybullet", questions(bare_file(Path(folder)), options))


def questions(file: Path, options: argparse.Namespace) -> Iterator[Question]:
    """Yield what is asked about each case."""
    model = nominal(file)
    for name in options.cases.split(","):
        log = recording(file, CASES[name], options)
        yield name, CASES[name].name, model, log


def bare_file(folder: Path) -> Path:
    """Write PyBullet's iiwa without its shapes."""
    source = Path(pybullet_data.getDataPath()) / "kuka_iiwa" / "model.urdf"
    text = re.sub(r"<(visual|collision)>.*?</\1>", "", source.read_text(), flags=re.DOTALL)
    (folder / "iiwa.urdf").write_text(text)
    return folder / "iiwa.urdf"


def nominal(file: Path) -> Model:
    """Return what the workflow is told: the robot file and the controller."""
    controller = {"kp": KP.tolist(), "kd": KD.tolist(), "rate_hz": RATE_HZ, "feedforward": "gravity-measured"}
    keys: dict[str, Any] = {"robot": file.name, "log_rate_hz": LOG_HZ, "controller": controller}
    return model_from_dict(keys, folder=file.parent)


def recording(file: Path, case: Case, options: argparse.Namespace) -> CalibrationLog:
    """Let PyBullet's arm follow waves of three frequencies a joint, from rest, and log it."""
    rng, motions, seconds = np.random.default_rng(options.seed), options.motions, options.seconds
    pybullet.connect(pybullet.DIRECT)
    try:
        pybullet.setGravity(0, 0, -9.81)
        pybullet.setPhysicsEngineParameter(fixedTimeStep=1.0 / (RATE_HZ * options.steps))
        known, real = loaded(file), loaded(file)
        if case.heavier is not None:
            link, mass = case.heavier
            before, _, inertia, *_ = pybullet.getDynamicsInfo(real, link - 1)
            # A new mass alone takes the link's inertia away, which the workflow said was missing.
            pybullet.changeDynamics(real, link - 1, mass=before + mass, localInertiaDiagonal=inertia)
        paths = [waves(rng, HOME, REACH, seconds, RATE_HZ) for _ in range(motions)]
        runs = [followed(known, real, case, path, options.steps) for path in paths]
    finally:
        pybullet.disconnect()
    setpoint, q, away, torque = (np.concatenate(parts) for parts in zip(*runs, strict=True))
    time, trajectory, session = stamps(motions, len(q) // motions, seconds, LOG_HZ)
    return CalibrationLog(
        time=time,
        trajectory=trajectory,
        session=session,
        setpoint_jp=setpoint,
        measured_jp=q + rng.normal(0.0, ENCODER, q.shape),
        measured_jf=torque,
        external_jp=q + away + rng.normal(0.0, OUTSIDE, q.shape),
    )


def loaded(file: Path) -> int:
    """Load the arm without PyBullet's own motors and its damping of all that moves."""
    arm: int = pybullet.loadURDF(str(file), useFixedBase=1, flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
    for joint in range(-1, 7):
        pybullet.changeDynamics(arm, joint, linearDamping=0, angularDamping=0, maxJointVelocity=100)
    for joint in range(7):
        pybullet.setJointMotorControl2(arm, joint, pybullet.VELOCITY_CONTROL, force=0)
    return arm


def followed(known: int, real: int, case: Case, wanted: FloatArray, steps: int) -> tuple[FloatArray, ...]:
    """Return what was wanted, where motors and joints were, and the torque, at the log's samples `(n, 7)` each."""
    pace, rows = np.gradient(wanted, 1.0 / RATE_HZ, axis=0), []
    kp, kd = KP * (1.0 + case.stiffer), KD * (1.0 + case.stiffer)
    for joint in range(7):
        pybullet.resetJointState(real, joint, wanted[0, joint], 0.0)
    for k in range(-RATE_HZ, len(wanted)):  # a second to come to rest
        i = max(k, 0)
        q, v = state(real)
        held = pybullet.calculateInverseDynamics(known, q.tolist(), [0.0] * 7, [0.0] * 7)
        torque = kp * (wanted[i] - q) + kd * ((pace[i] if k >= 0 else 0.0) - v) + case.fed * np.array(held)
        if k >= 0 and k % (RATE_HZ // LOG_HZ) == 0:
            rows.append((wanted[i], q, case.away(q, v, torque), torque))
        for _ in range(steps):
            q, v = state(real)
            forces = torque + case.torque(q, v, torque)
            pybullet.setJointMotorControlArray(real, range(7), pybullet.TORQUE_CONTROL, forces=forces.tolist())
            pybullet.stepSimulation()
    return tuple(np.array(part) for part in zip(*rows, strict=True))


def state(arm: int) -> tuple[FloatArray, FloatArray]:
    """Return joints and their speeds `(7,)`."""
    states = pybullet.getJointStates(arm, range(7))
    return np.array([one[0] for one in states]), np.array([one[1] for one in states])


if __name__ == "__main__":
    main()
