"""From a wish and a seed to a recording, what is known of the machine, and what is hidden in it."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from truth import recipe
from truth.hidden import Growth, Hidden, rigidly
from truth.history import Readings
from truth.loop import CONTROL_HZ, TICK_HZ
from truth.noise import draw_noise, noise_of
from truth.recipe import Truth, hide, sized
from truth.record import tracked
from truth.reference import Reference, separating
from truth.spec import Case

from gpcorrect.types import CalibrationLog, LogMeta
from truth_mujoco.arms import Arm
from truth_mujoco.causes import cause_named
from truth_mujoco.causes.cause import Scene
from truth_mujoco.facts import labels_of, nominal_tables
from truth_mujoco.machine import draw_machine, readings_of, simulate
from truth_mujoco.motion import Run
from truth_mujoco.plant import nominal_torques
from truth_mujoco.spec import Spec

Array = NDArray[np.float64]

JOINT_NOISE = {"R": 2.5e-4, "P": 4e-5}  # rad and m; typical white part of the outside joint sensors
TRACKER_NOISE = 1.5e-4  # m
LEVER = 0.1  # m; from a tracker's noise to a joint's
NOISE_FACTOR = 2.0  # by which the noise may differ from what was drawn, to meet a ratio
JOINTS_TRIED = 3  # until one lets a cause be as large as asked
PHYSICAL = {
    "resonance": {"frequency": (5.0, 40.0)},
    "capstan_friction": {"wrap": (1e-4, 0.5)},
    "payload": {"mass": (2e-3, 1.0)},
    "delay": {"delay": (2e-4, 0.05)},
    "transmission_ratio": {"error": (-0.2, 0.2)},
    "shaft_bending": {"rigidity": (0.2, 200.0)},
    "rcm_shift": {"stiffness": (300.0, 1e7)},
    "feedforward_error": {"fraction": (-1.0, 1.0)},
    "gain_error": {"proportional": (-0.6, 1.5), "derivative": (-0.6, 1.5)},
    "swaying_base": {"angle": (1e-4, 0.3)},
    "link_mass_error": {"mass": (-0.1, 3.0)},
    "centre_of_mass_error": dict.fromkeys("xyz", (-0.4, 0.4)),
    "gravity_error": dict.fromkeys("xyz", (-8.0, 8.0)),
    "inertia_error": {"inertia": (0.0, 130.0)},  # twice the largest motor here
}
GROWTH = Growth(close=0.1, tries=8, stride=2.0, physical=PHYSICAL)


@dataclass(frozen=True, eq=False)
class Setting(recipe.Setting):
    """A case before anything is hidden in it, with its run."""

    torques: Array
    before: Run

    @property
    def tracker(self) -> float:
        """RMS of the tracker's noise."""
        return float(np.sqrt(np.mean(self.tracker_noise.rms**2)))

    @property
    def noise_at_joints(self) -> Array:
        """RMS `(k,)` of the noise as seen at the joints."""
        if self.spec.signals != "tracker":
            return self.joint_noise.rms
        lever = np.array([LEVER if kind == "R" else 1.0 for kind in self.machine.arm.types])
        return self.tracker / lever

    @property
    def moved(self) -> tuple[Array, Array]:
        """Motors as they are reported, and commanded torques."""
        return self.before.recorded.reported, self.before.recorded.command

    def along(self, reference: Reference) -> Setting:
        """Run along another reference."""
        torques = nominal_torques(self.machine.plant, reference)
        before, readings = simulate(self.machine, reference, torques)
        return replace(self, reference=reference, torques=torques, before=before, readings=readings)

    def run(self, hidden: Sequence[Hidden]) -> Readings:
        """Run with causes."""
        return simulate(self.machine, self.reference, self.torques, hidden, self.before)[1]

    def read(self, hidden: Sequence[Hidden]) -> Readings:
        """Read the motion as it was."""
        return readings_of(self.machine, self.before, hidden)

    def ratio(self, hidden: Hidden, with_it: Readings, without: Readings, rows: NDArray[np.int64]) -> float:
        """RMS of the trace of a cause over RMS of the noise, in the sensors that show it best."""
        cause, j, noise = cause_named(hidden.name), hidden.column, self.joint_noise.rms
        if cause.channel == "noise":
            return float(np.sqrt(np.mean(with_it.extra_noise[rows, j] ** 2)) / noise[j])
        if cause.channel == "reported":
            trace = (with_it.reported - without.reported)[rows, j]
            return float(np.sqrt(np.mean(trace**2)) / noise[j])
        found = []
        if self.spec.signals in ("tracker", "both"):
            before, after = without.tip[rows, :3, 3], with_it.tip[rows, :3, 3]
            # a registration left to the data takes up what a rigid motion can
            miss = after - (before if self.registered else rigidly(before, after))
            found.append(float(np.sqrt(np.mean(miss**2))) / self.tracker)
        if self.spec.signals != "tracker" and not cause.tracker_only:
            each = np.sqrt(np.mean((with_it.outside - without.outside)[rows] ** 2, axis=0)) / noise
            if cause.feedforward:
                moved = (with_it.reported - without.reported)[rows]
                each = np.maximum(each, np.sqrt(np.mean(moved**2, axis=0)) / noise)
            found.append(float(each[j] if cause.where == "joint" else each.max()))
        return max(found)


def make_case(spec: Spec, seed: int) -> Case:
    """Make one recording with hidden causes; the same wish and seed give the same bytes."""
    return make_truth(spec, seed).case


def make_truth(spec: Spec, seed: int) -> Truth:
    """Make the same recording, and say what no one is told: what was true with and without the causes."""
    rng = np.random.default_rng([seed, zlib.crc32(repr(spec).encode())])
    setting = prepared(spec, rng)
    hidden = [_placed(setting, name, rng) for name in spec.hidden]
    setting, readings, ratios = hide(setting, hidden, NOISE_FACTOR)
    log = recorded(setting, readings, rng)
    case = Case(log, nominal_tables(setting, rng), labels_of(setting, hidden, ratios, seed))
    return Truth(case, setting, readings, tuple(hidden))


def prepared(spec: Spec, rng: np.random.Generator) -> Setting:
    """Draw a machine, a motion and the sensors' noise, and run it without any hidden cause."""
    wanted = max((cause_named(name).feedforward for name in spec.hidden), default="")
    machine = draw_machine(rng, spec.arm, tracked=spec.signals in ("tracker", "both"), feedforward=wanted)
    arm = machine.arm
    reference = separating(rng, spec.trajectories, spec.seconds, spec.sessions, arm.ranges, arm.payloads)
    torques = nominal_torques(machine.plant, reference)
    run, readings = simulate(machine, reference, torques)
    registered = "registration_error" in spec.hidden or bool(rng.random() < 0.5)
    joint_noise = draw_noise(rng, np.array([JOINT_NOISE[kind] for kind in arm.types]), "")
    tracker_noise = draw_noise(rng, np.full(3, TRACKER_NOISE), "")
    return Setting(spec, machine, reference, readings, joint_noise, tracker_noise, registered, torques, run)


def _placed(setting: Setting, name: str, rng: np.random.Generator) -> Hidden:
    """Return a cause of about the asked size, on the first joint of a random order that lets it be that large."""
    cause, scene = cause_named(name), Scene(setting.before, setting.noise_at_joints, setting.spec.sessions)
    best, best_miss = None, np.inf
    for j in rng.permutation(_columns(setting.machine.arm, name))[:JOINTS_TRIED]:
        drawn, size = Hidden(name, int(j), cause.draw(rng, int(j), scene)), setting.spec.ratio
        hidden, ratio = sized(setting, drawn, cause, GROWTH, start=size, in_loop=cause.build is not None)
        miss = abs(float(np.log(max(ratio, 1e-9) / size)))
        if miss < best_miss:
            best, best_miss = hidden, miss
        if miss < np.log(NOISE_FACTOR):
            break
    return best


def _columns(arm: Arm, name: str) -> list[int]:
    """Columns that a cause may sit on."""
    if name == "dh_error":  # between two moving joints, where no registration and no tool takes it up
        return [1, 2] if arm.modified else [0, 1]
    if name in ("length_dependent_stiffness", "capstan_friction"):
        return [0, 1]  # joints that carry a load worth the name
    return list(range(arm.dof))


def recorded(setting: Setting, readings: Readings, rng: np.random.Generator) -> CalibrationLog:
    """Sample what was true at the log's rate, with the noise of joint sensors and tracker, encoder steps and holes.

    Where only a tracker looks on, the motors are written down beside it.
    """
    machine, reference = setting.machine, setting.reference
    arm, rows = machine.arm, reference.logged
    trajectory = reference.trajectory[rows]
    pace = np.abs(reference.speed[:: CONTROL_HZ // TICK_HZ][rows])
    pace = (pace / np.maximum(pace.max(axis=0), 1e-12)).max(axis=1)
    reported = np.round(readings.reported[rows] / arm.encoder_step) * arm.encoder_step
    signals: dict[str, Any] = {
        "setpoint_jp": reference.position[:: CONTROL_HZ // TICK_HZ][rows],
        "measured_jp": reported,
        "measured_jf": None if arm.bare else readings.effort[rows],
    }
    if setting.spec.signals != "tracker":
        noise = noise_of(setting.joint_noise, rng, trajectory, pace, readings.extra_noise[rows])
        signals["external_jp"] = readings.outside[rows] + noise
    if machine.tracked:
        noise = noise_of(setting.tracker_noise, rng, trajectory, pace, np.zeros((len(rows), 3)))
        signals["tracker_cp"] = tracked(machine.T_tracker_base, readings.tip[rows], noise, rng)
    return CalibrationLog(
        time=reference.time[rows],
        trajectory=trajectory,
        session=reference.session[rows],
        payload=reference.payload[rows] if reference.payload.any() else None,
        name="recording",
        meta=LogMeta(
            robot="test arm",
            arm=arm.declared,
            joint_types=arm.types,
            tracker="camera" if machine.tracked else "",
        ),
        **signals,
    )
