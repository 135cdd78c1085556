"""From a wish and a seed to a recording, what is known of the machine, and what is hidden in it."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from truth.alike import side_of
from truth.case import Truth, few_of
from truth.hidden import Hidden
from truth.history import Readings
from truth.loop import CONTROL_HZ, TICK_HZ
from truth.noise import NoiseLaw, draw_noise, noise_of
from truth.record import tracked
from truth.reference import Reference, separating
from truth.spec import Case

from gpcorrect.types import CalibrationLog, LogMeta
from truth_mujoco.arms import Arm
from truth_mujoco.causes import cause_named
from truth_mujoco.causes.cause import Scene
from truth_mujoco.facts import labels_of, nominal_tables
from truth_mujoco.machine import Machine, draw_machine, readings_of, simulate
from truth_mujoco.motion import Run
from truth_mujoco.plant import nominal_torques
from truth_mujoco.sizing import GROWTH, Meter
from truth_mujoco.spec import Spec

Array = NDArray[np.float64]

JOINT_NOISE = {"R": 2.5e-4, "P": 4e-5}  # rad and m; typical white part of the outside joint sensors
TRACKER_NOISE = 1.5e-4  # m
LEVER = 0.1  # m; from a tracker's noise to a joint's
NOISE_FACTOR = 2.0  # by which the noise may differ from what was drawn, to meet a ratio
JOINTS_TRIED = 3  # until one lets a cause be as large as asked


@dataclass(frozen=True, eq=False)
class Setting:
    """A case before anything is hidden in it."""

    spec: Spec
    machine: Machine
    reference: Reference
    torques: Array
    run: Run
    readings: Readings
    joint_noise: NoiseLaw
    tracker_noise: NoiseLaw
    registered: bool

    @property
    def meter(self) -> Meter:
        """Return how ratios are measured here."""
        tracker = float(np.sqrt(np.mean(self.tracker_noise.rms**2)))
        return Meter(self.spec.signals, self.joint_noise.rms, tracker, not self.registered)

    @property
    def noise_at_joints(self) -> Array:
        """RMS `(k,)` of the noise as seen at the joints."""
        if self.spec.signals != "tracker":
            return self.joint_noise.rms
        lever = np.array([LEVER if kind == "R" else 1.0 for kind in self.machine.arm.types])
        return self.meter.tracker / lever

    def with_noise(self, factor: float) -> Setting:
        """Return the same with another level of noise."""
        return replace(self, joint_noise=self.joint_noise.times(factor), tracker_noise=self.tracker_noise.times(factor))


def make_case(spec: Spec, seed: int) -> Case:
    """Make one recording with hidden causes; the same wish and seed give the same bytes."""
    return make_truth(spec, seed).case


def make_truth(spec: Spec, seed: int) -> Truth:
    """Make the same recording, and say what no one is told: what was true with and without the causes."""
    rng = np.random.default_rng([seed, zlib.crc32(repr(spec).encode())])
    setting = prepared(spec, rng)
    hidden = [_placed(setting, name, rng) for name in spec.hidden]
    setting, readings, ratios = _hide(setting, hidden)
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
    return Setting(spec, machine, reference, torques, run, readings, joint_noise, tracker_noise, registered)


def _placed(setting: Setting, name: str, rng: np.random.Generator) -> Hidden:
    """Return a cause of about the asked size, on the first joint of a random order that lets it be that large."""
    scene = Scene(setting.run, setting.noise_at_joints, setting.spec.sessions)
    best, best_miss = None, np.inf
    for j in rng.permutation(_columns(setting.machine.arm, name))[:JOINTS_TRIED]:
        hidden, ratio = _sized(setting, Hidden(name, int(j), cause_named(name).draw(rng, int(j), scene)))
        miss = abs(float(np.log(max(ratio, 1e-9) / setting.spec.ratio)))
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


def _sized(setting: Setting, hidden: Hidden) -> tuple[Hidden, float]:
    """Return the cause at about the asked ratio, and its ratio on the whole run or, in MuJoCo's model, a part of it."""
    cause, meter = cause_named(hidden.name), setting.meter
    reference, torques, run, without = setting.reference, setting.torques, setting.run, setting.readings
    if cause.build is not None:
        reference = _draft(setting, hidden)
        torques = nominal_torques(setting.machine.plant, reference)
        run, without = simulate(setting.machine, reference, torques)
    rows = reference.logged
    share = len(rows) / len(setting.reference.logged) if cause.peaks else 1.0

    def measure(trial: Hidden) -> float:
        if cause.build is not None:
            _, with_it = simulate(setting.machine, reference, torques, [trial])
        else:
            with_it = readings_of(setting.machine, run, [trial])
        return meter.ratio(trial, with_it, without, rows) * float(np.sqrt(share))

    ratio = setting.spec.ratio
    return GROWTH.grown(cause, hidden, ratio, measure, start=ratio)


def _draft(setting: Setting, hidden: Hidden) -> Reference:
    """Return a few trajectories: the most extreme ones for a cause that acts at peaks, else spread evenly."""
    recorded, peak = setting.run.recorded, None
    if cause_named(hidden.name).peaks:
        peak = side_of(hidden.params) * recorded.reported if "end" in hidden.params else np.abs(recorded.command)
        peak = peak[:, hidden.column]
    return few_of(setting.reference, setting.spec.trajectories, peak)


def _hide(setting: Setting, hidden: Sequence[Hidden]) -> tuple[Setting, Readings, list[float]]:
    """Run the machine with its causes and set the noise so that the ratios hold (on geometric average, of several).

    Noise changes by no more than a factor; a cause that physics keeps smaller or larger has the ratio that it has.
    """
    if not hidden:
        return setting, setting.readings, []
    _, readings = simulate(setting.machine, setting.reference, setting.torques, hidden, setting.run)
    ratios = [_own_ratio(setting, h, readings, alone=len(hidden) == 1) for h in hidden]
    wanted = float(np.exp(np.mean(np.log(np.maximum(ratios, 1e-6) / setting.spec.ratio))))
    factor = float(np.clip(wanted, 1.0 / NOISE_FACTOR, NOISE_FACTOR))
    return setting.with_noise(factor), readings, [r / factor for r in ratios]


def _own_ratio(setting: Setting, hidden: Hidden, readings: Readings, *, alone: bool) -> float:
    """Ratio of one cause on the whole run; among others, it is run once more by itself."""
    if not alone:
        _, readings = simulate(setting.machine, setting.reference, setting.torques, [hidden], setting.run)
    return setting.meter.ratio(hidden, readings, setting.readings, setting.reference.logged)


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
