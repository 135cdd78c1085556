"""The workflow on two arms that Drake moves under controllers of its own: six geared axes, and one that inserts a tool.

    pip install drake
    python bench/discrepancy_drake.py [--cases "six nothing,insertion coulomb" --motions 8 --seconds 8 --seed 0]

Nothing of the project makes the recordings: Drake integrates the links with error control (Runge-Kutta of third order,
a controller's step or less at a time), its inverse dynamics feed torques forward, and what is hidden is a number in the
URDF that Drake reads and the workflow does not, a spring of Drake's between motor and link, or a torque written here.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from drake_arms import INSERTION, SIX, Arm
from engine_cases import Question, ask, stamps, waves
from support import print_load

from gpcorrect.sim import Model, model_from_dict
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

try:
    from pydrake.math import RigidTransform, RollPitchYaw
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import MultibodyForces, RevoluteSpring
    from pydrake.systems.analysis import Simulator
except ImportError:
    raise SystemExit("skipped: Drake is not installed (pip install drake)") from None

LOG_HZ, BRAKE, WALL = (
    50,
    0.002,
    5e4,
)  # BRAKE: rad/s at which dry friction has most of its torque; WALL: N m/rad of a gap
ENCODER, OUTSIDE = 2e-5, 1e-4  # rad, white noise of motor encoders and outside ones; of a slide a fifth, in m
TRACKER, TURNED = 1e-4, 5e-4  # m and rad, white noise of a tracker
TRACKER_BASE = RigidTransform(RollPitchYaw(0.3, -0.4, 1.1), [0.8, -1.2, 0.5])
Law = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]


def nothing(q: FloatArray, v: FloatArray, torque: FloatArray) -> FloatArray:
    """No torque."""
    return np.zeros(len(q))


@dataclass(frozen=True)
class Case:
    """What is hidden.

    `real` is Drake's arm, and `knows` what the controller has of it; the workflow is given `knows` and `told`.
    """

    name: str  # of the catalogue; empty where nothing is hidden, ? where nothing of it is
    real: Callable[[Arm], Arm] = lambda arm: arm
    knows: Callable[[Arm], Arm] = lambda arm: arm
    gains: tuple[int, float] = (1, 0.0)  # joint, and by what fraction its gains are off
    fed: tuple[int, float] = (1, 0.0)  # joint, and by what fraction its feedforward is off
    torque: Law = nothing  # of friction and the like, on each motor; for a gap on the link too
    steps: int = 1  # in which torques are held constant, of each of the controller's
    ratio: tuple[int, float] = (1, 0.0)  # joint, and what its transmission tells more than it turns
    late: int = 0  # steps of the controller that its command is late
    seen_late: int = 0  # the same of the outside sensors
    off: FloatArray = field(default_factory=lambda: np.zeros(1))  # of where the motors think that joints are
    gap: float = 0.0  # rad to either side, of the flexible joint
    tracked: bool = False  # by a tracker, and not by encoders outside
    placed: RigidTransform = field(default_factory=RigidTransform)  # of the tracker, beside where it is said to be
    waves: tuple[float, float] = (0.05, 0.45)  # Hz
    crossed: tuple[int, int, float] = (1, 1, 0.0)  # a joint's motor tells this much of another joint too


def dry(joint: int, size: float) -> Law:
    """Return dry friction at a motor."""

    def law(q: FloatArray, v: FloatArray, torque: FloatArray) -> FloatArray:
        result = np.zeros(len(q))
        result[joint - 1] = -size * np.tanh(v[joint - 1] / BRAKE)
        return result

    return law


def cogging(joint: int, size: float) -> Law:
    """Return a torque that comes and goes 24 times a turn."""

    def law(q: FloatArray, v: FloatArray, torque: FloatArray) -> FloatArray:
        result = np.zeros(len(q))
        result[joint - 1] = size * np.sin(24.0 * q[joint - 1])
        return result

    return law


def fed_forward(kind: str, **numbers: Any) -> Callable[[Arm], Arm]:
    """Return a change of an arm's controller."""
    return lambda arm: replace(arm, feedforward=kind, **numbers)


def slower(arm: Arm) -> Arm:
    """Return the arm with a controller of 500 Hz that knows gravity where the arm should be, and sums errors."""
    return replace(arm, rate_hz=500, feedforward="gravity", ki=1.5 * arm.kp)


FAST = (0.2, 1.0)
SKEW = RigidTransform(RollPitchYaw(0.004, -0.003, 0.005), [0.003, -0.002, 0.004])
CASES: dict[str, tuple[Arm, Case]] = {
    "six nothing": (SIX, Case("")),
    "insertion nothing": (INSERTION, Case("")),
    "six nothing fast": (SIX, Case("", waves=FAST)),
    "insertion nothing fast": (INSERTION, Case("", waves=FAST)),
    "six nothing 500 Hz integral": (SIX, Case("", knows=slower)),
    "insertion nothing 500 Hz integral": (INSERTION, Case("", knows=slower)),
    "six nothing rigid body": (SIX, Case("", knows=fed_forward("rigid-body"))),
    "insertion nothing rigid body": (INSERTION, Case("", knows=fed_forward("rigid-body"))),
    "six nothing none fed": (SIX, Case("", knows=fed_forward("none"))),
    "insertion nothing none fed": (INSERTION, Case("", knows=fed_forward("none"))),
    "six nothing tracker": (SIX, Case("", tracked=True)),
    "insertion nothing tracker": (INSERTION, Case("", tracked=True)),
    "six nothing fast rigid body": (SIX, Case("", waves=FAST, knows=fed_forward("rigid-body"))),
    "insertion nothing fast rigid body": (INSERTION, Case("", waves=FAST, knows=fed_forward("rigid-body"))),
    "six coulomb": (SIX, Case("coulomb_friction 2", torque=dry(2, 8.0), steps=8)),
    "six viscous": (SIX, Case("viscous_friction 3", real=lambda arm: arm.but(3, damping=6.0))),
    "six heavy": (SIX, Case("link_mass_error 3", real=lambda arm: arm.but(3, heavier=0.5))),
    "six gain": (SIX, Case("gain_error 2", gains=(2, -0.15))),
    "six gravity": (SIX, Case("feedforward_error 3", fed=(3, -0.3))),
    "six ratio": (SIX, Case("transmission_ratio 3", ratio=(3, 0.004))),
    "six spring": (SIX, Case("cable_stretch 2", real=lambda arm: replace(arm, flexible=2, spring=25000.0))),
    "six gap": (
        SIX,
        Case("loaded_backlash 1", real=lambda arm: replace(arm, flexible=1, spring_damping=40.0), gap=0.0015, steps=8),
    ),
    "six payload": (SIX, Case("payload", real=lambda arm: replace(arm, payload=0.7))),
    "six rotor": (SIX, Case("inertia_error 1", real=lambda arm: arm.but(1, rotor=1.35e-4))),
    "six late": (SIX, Case("command_delay", late=8)),
    "six cogging": (SIX, Case("?", torque=cogging(2, 8.0), steps=4)),
    "six homing": (SIX, Case("homing_offset 4", off=np.array([0, 0, 0, 0.003, 0, 0]))),
    "six tilt": (SIX, Case("gravity_error", real=lambda arm: replace(arm, gravity=(0.3, 0.2, -9.8)))),
    "six tool": (
        SIX,
        Case("dh_error tool", real=lambda arm: replace(arm, flange=(0.003, -0.002, 0.074)), tracked=True),
    ),
    "six table": (SIX, Case("registration_error", placed=SKEW, tracked=True)),
    "insertion coulomb": (INSERTION, Case("coulomb_friction 3", torque=dry(3, 6.0), steps=8)),
    "insertion viscous": (INSERTION, Case("viscous_friction 1", real=lambda arm: arm.but(1, damping=0.8))),
    "insertion heavy": (INSERTION, Case("link_mass_error 3", real=lambda arm: arm.but(3, heavier=0.3))),
    "insertion gain": (INSERTION, Case("gain_error 3", gains=(3, -0.2))),
    "insertion gravity": (INSERTION, Case("feedforward_error 2", fed=(2, -0.5))),
    "insertion ratio": (INSERTION, Case("transmission_ratio 3", ratio=(3, 0.01))),
    "insertion spring": (INSERTION, Case("cable_stretch 2", real=lambda arm: replace(arm, flexible=2, spring=1500.0))),
    "insertion payload": (INSERTION, Case("payload", real=lambda arm: replace(arm, payload=0.15))),
    "insertion rotor": (INSERTION, Case("inertia_error 3", real=lambda arm: arm.but(3, rotor=3e-5))),
    "insertion late": (INSERTION, Case("command_delay", late=8)),
    "insertion seen late": (INSERTION, Case("delay", seen_late=8)),
    "insertion cross talk": (INSERTION, Case("cable_coupling 3", crossed=(3, 2, 0.003))),
}


class Machine:
    """An arm in Drake."""

    def __init__(self, arm: Arm) -> None:
        self.arm, self.dof = arm, len(arm.links)
        self.plant = MultibodyPlant(0.0)
        Parser(self.plant).AddModelsFromString(arm.urdf(), "urdf")
        self.plant.WeldFrames(self.plant.world_frame(), self.plant.GetFrameByName("base"))
        self.plant.mutable_gravity_field().set_gravity_vector(arm.gravity)
        if arm.flexible and arm.spring:
            flex = self.plant.GetJointByName(f"flex{arm.flexible}")
            self.plant.AddForceElement(RevoluteSpring(flex, 0.0, arm.spring))
        self.plant.Finalize()
        joints = [self.plant.GetJointByName(f"joint{i}") for i in range(1, self.dof + 1)]
        self.motors = np.array([joint.position_start() for joint in joints])
        if arm.flexible:
            self.flex = self.plant.GetJointByName(f"flex{arm.flexible}").position_start()
        self.simulator = Simulator(self.plant)
        self.simulator.get_mutable_integrator().set_target_accuracy(1e-7)
        self.context = self.simulator.get_mutable_context()
        self.flange = self.plant.GetFrameByName("flange")

    def motor_state(self) -> tuple[FloatArray, FloatArray]:
        """Return where the motors are, in joint units, and how fast."""
        return self.plant.GetPositions(self.context)[self.motors], self.plant.GetVelocities(self.context)[self.motors]

    def joints(self) -> FloatArray:
        """Return where the links are."""
        positions = self.plant.GetPositions(self.context)
        q: FloatArray = positions[self.motors]
        if self.arm.flexible:
            q[self.arm.flexible - 1] += positions[self.flex]
        return q

    def pose(self) -> RigidTransform:
        """Return where the flange is."""
        return self.flange.CalcPoseInWorld(self.context)

    def wanted_torque(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return the torque of a motion by this arm's own inverse dynamics."""
        self.plant.SetPositions(self.context, q)
        self.plant.SetVelocities(self.context, v)
        forces = MultibodyForces(self.plant)
        self.plant.CalcForceElementsContribution(self.context, forces)
        return self.plant.CalcInverseDynamics(self.context, a, forces)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", default=",".join(CASES), help="names, separated by commas")
    parser.add_argument("--motions", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    print_load()
    with tempfile.TemporaryDirectory() as folder:
        ask("discrepancy_drake", questions(Path(folder), options))


def questions(folder: Path, options: argparse.Namespace) -> Iterator[Question]:
    """Yield what is asked about each case."""
    for name in options.cases.split(","):
        arm, case = CASES[name]
        known = case.knows(arm)
        rng = np.random.default_rng(options.seed)
        runs = [
            waves(rng, arm.home, arm.reach, options.seconds, known.rate_hz, case.waves) for _ in range(options.motions)
        ]
        log = recording(known, case, runs, rng)
        yield name, case.name, nominal(known, folder, tracked=case.tracked), log


def nominal(arm: Arm, folder: Path, *, tracked: bool = False) -> Model:
    """Return what the workflow is told: the URDF, the controller, and what the rotors are behind their gears."""
    (folder / f"{arm.name}.urdf").write_text(arm.urdf())
    controller = {
        "kp": arm.kp.tolist(),
        "kd": arm.kd.tolist(),
        "rate_hz": arm.rate_hz,
        "feedforward": arm.feedforward,
    }
    if arm.ki.any():
        controller["ki"] = arm.ki.tolist()
    keys: dict[str, Any] = {
        "robot": f"{arm.name}.urdf",
        "log_rate_hz": LOG_HZ,
        "controller": controller,
        "transmission": {"motor_inertia": [link.reflected for link in arm.links]},
    }
    if tracked:
        keys["T_tracker_base"] = {
            "translation": TRACKER_BASE.translation().tolist(),
            "rotvec": (
                TRACKER_BASE.rotation().ToAngleAxis().angle() * TRACKER_BASE.rotation().ToAngleAxis().axis()
            ).tolist(),
        }
    return model_from_dict(keys, folder=folder)


def recording(known: Arm, case: Case, runs: list[FloatArray], rng: np.random.Generator) -> CalibrationLog:
    """Let Drake's arm follow, and log it as a lab would."""
    made = [followed(known, case, wanted) for wanted in runs]
    setpoint, q, joints, torque, poses = (np.concatenate(parts) for parts in zip(*made, strict=True))
    seconds = (len(runs[0]) - 1) / known.rate_hz
    time, trajectory, session = stamps(len(runs), len(q) // len(runs), seconds, LOG_HZ)
    scale = np.where([link.kind == "prismatic" for link in known.links], 0.2, 1.0)
    seen: dict[str, Any] = {"external_jp": joints + scale * rng.normal(0.0, OUTSIDE, q.shape)}
    if case.tracked:
        seen = {"tracker_cp": seen_by_tracker(poses, case, rng)}
    return CalibrationLog(
        time=time,
        trajectory=trajectory,
        session=session,
        setpoint_jp=setpoint,
        measured_jp=q + scale * rng.normal(0.0, ENCODER, q.shape),
        measured_jf=torque,
        **seen,
    )


def seen_by_tracker(poses: FloatArray, case: Case, rng: np.random.Generator) -> PoseSignal:
    """Return poses `(n, 4, 4)` as a tracker sees them: positions and quaternions with white noise."""
    table = []
    for pose in poses:
        turn = RollPitchYaw(rng.normal(0.0, TURNED, 3)).ToRotationMatrix()
        seen = TRACKER_BASE @ case.placed @ RigidTransform(pose)
        position = seen.translation() + rng.normal(0.0, TRACKER, 3)
        table.append(np.concatenate([position, (seen.rotation() @ turn).ToQuaternion().wxyz()]))
    return PoseSignal.of(np.array(table))


def followed(known: Arm, case: Case, wanted: FloatArray) -> tuple[FloatArray, ...]:
    """Return what was wanted, where motors said and links were, torque, and poses, at the log's samples."""
    model, real, step = Machine(known), Machine(case.real(known)), 1.0 / known.rate_hz
    pace = np.gradient(wanted, step, axis=0)
    rush, rest = np.gradient(pace, step, axis=0), np.zeros(real.dof)
    gains, share, ratio = np.ones(real.dof), np.ones(real.dof), np.eye(real.dof)
    gains[case.gains[0] - 1] += case.gains[1]
    share[case.fed[0] - 1] += case.fed[1]
    for joint, source, value in ((case.ratio[0], *case.ratio), case.crossed):
        ratio[joint - 1, source - 1] += value
    off = np.broadcast_to(case.off, real.dof)
    start = np.linalg.solve(ratio, wanted[0] - off - known.home) + known.home
    positions = np.zeros(real.plant.num_positions())
    positions[real.motors] = start
    real.plant.SetPositions(real.context, positions)
    real.simulator.Initialize()
    summed, rows, past = np.zeros(real.dof), [], []
    actuation = real.plant.get_actuation_input_port()
    applied = real.plant.get_applied_generalized_force_input_port()
    for k in range(-2 * known.rate_hz, len(wanted)):  # two seconds to come to rest
        i = max(k - case.late, 0)
        moving = k - case.late >= 0
        turned, speed = real.motor_state()
        q, v = known.home + ratio @ (turned - known.home) + off, ratio @ speed
        desired = (wanted[i], pace[i] if moving else rest, rush[i] if moving else rest)
        torque = gains * (known.kp * (desired[0] - q) + known.kd * (desired[1] - v))
        summed = summed + step * known.ki * (desired[0] - q)
        torque = torque + summed + share * fed_by(model, known, q, desired)
        past = (
            [*past[-case.seen_late :], (real.joints(), real.pose().GetAsMatrix4())]
            if case.seen_late
            else [(real.joints(), real.pose().GetAsMatrix4())]
        )
        if k >= 0 and k % (known.rate_hz // LOG_HZ) == 0:
            rows.append((wanted[k], q, past[0][0], torque, past[0][1]))
        for _ in range(case.steps):
            turned, speed = real.motor_state()
            actuation.FixValue(real.context, ratio.T @ torque + case.torque(turned, speed, torque))
            if real.arm.flexible:
                applied.FixValue(real.context, in_flex(real, case))
            real.simulator.AdvanceTo(real.context.get_time() + step / case.steps)
    return tuple(np.array(part) for part in zip(*rows, strict=True))


def fed_by(model: Machine, known: Arm, q: FloatArray, desired: tuple[FloatArray, ...]) -> FloatArray:
    """Return the torque that the controller feeds forward."""
    rest = np.zeros(model.dof)
    if known.feedforward == "none":
        return rest
    if known.feedforward == "rigid-body":
        return model.wanted_torque(*desired)
    return model.wanted_torque(q if known.feedforward == "gravity-measured" else desired[0], rest, rest)


def in_flex(real: Machine, case: Case) -> FloatArray:
    """Return the torques of the gap or the damping of the spring between a motor and its link, held for a step."""
    state, speed = real.plant.GetPositions(real.context), real.plant.GetVelocities(real.context)
    result = np.zeros(len(speed))
    beyond = state[real.flex] - np.clip(state[real.flex], -case.gap, case.gap)
    if case.gap and beyond:
        result[real.flex] = -WALL * beyond
    if not case.gap or beyond:
        result[real.flex] -= real.arm.spring_damping * speed[real.flex]
    return result


if __name__ == "__main__":
    main()
