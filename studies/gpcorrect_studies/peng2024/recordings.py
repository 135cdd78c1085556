"""Recordings of the joint-level calibration study on the simulated RAVEN-II: zig-zags, hours of use, homings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.arms import arm_named
from gpcorrect.calibration import direction_named, random_sweeps, timed, zigzag
from gpcorrect.sim import Model, Segment, machine_of, plan_of, preset, simulate
from gpcorrect.sim.effects.geometry import HomingOffset
from gpcorrect.sim.effects.over_time import Drift
from gpcorrect.sim.plan import NOT_LOGGED
from gpcorrect.types import CalibrationLog, FloatArray

ARM = "raven2_left"  # its kinematics are those of the study's arm
PRESET = "raven2_calibration"  # the simulated machine
DEGREE = np.deg2rad(1.0)

# Block of the zig-zags, rad, rad, m. Chosen by hand inside the joint limits.
LIMITS = np.array([[20 * DEGREE, 60 * DEGREE], [55 * DEGREE, 110 * DEGREE], [0.33, 0.42]])
# Random tests stay in its middle 60 %, so that no method extrapolates; chosen by hand.
TEST_LIMITS = LIMITS.mean(axis=1)[:, None] + np.ptp(LIMITS, axis=1)[:, None] * np.array([-0.3, 0.3])
# Speeds of the study's public controller: of its trajectory follower, and of its random motion from and to.
SPEED = np.array([3 * DEGREE, 3 * DEGREE, 0.01])
SLOW, FAST = np.array([[1.1 * DEGREE, 1.5 * DEGREE, 0.0025], [2.2 * DEGREE, 3.0 * DEGREE, 0.005]])
HOME = np.array([30 * DEGREE, 90 * DEGREE, 0.40])  # where every homing ends; chosen by hand inside the block
# SD of a homing's shift: joint 2 moves most, by a few tenths of a degree, as the study says; the others by hand.
HOMING_SPREAD: dict[int | str, float] = {1: 0.1 * DEGREE, 2: 0.3 * DEGREE, 3: 1e-4}
SETTLED = 600.0  # s after a homing at which recordings are made; chosen by hand
LOADED_DRIFT = 1.75  # over the unloaded one: for the study's two figures for joint 1 after six hours

COUNTS_PER_RAD = 4000.0 / (2.0 * np.pi)  # only a unit, as features are scaled before any fit
AMPLIFIER_COUNTS = 1000.0  # a N m at the motor: only a unit too
RESTING_JITTER = 1e-5  # of a resting arm's readings, chosen by hand: the last digit of an encoder now and then


@dataclass(frozen=True)
class RavenStudy:
    """The simulated arm and its seed."""

    seed: int = 0  # of noise, homings and random motion
    homings: int = 5  # homings after the first
    as_published: bool = False  # drive the zig-zag along J1-J2-J3 as the study's files do, not as its Eq. (3) says
    machine: Model | None = None  # another than the packaged one

    def zigzags(
        self, direction: str, sparsity: int, *, sessions: Sequence[int] = (0,), repeat: int = 0
    ) -> CalibrationLog:
        """Return a zig-zag in each session, ten minutes after its homing.

        Parameters
        ----------
        direction : str, joints that move together, such as "J1-J2"
        sparsity : int, n of the sparsity 1/n
        sessions : sequence of int, homings before each zig-zag, less one
        repeat : int, another repeat has other noise
        """
        corners = zigzag(direction_named(direction), sparsity, LIMITS, as_published=self.as_published)
        path = timed(corners, SPEED, self._rate()).q
        return self._log([self._from_home(path, session, SETTLED) for session in sessions], 1000 + repeat)

    def random_run(self, minutes: float, *, session: int = 0, salt: int = 2) -> CalibrationLog:
        """Return random sweeps inside the block that the zig-zags fill.

        Parameters
        ----------
        minutes : float
        session : int, homings before it, less one
        salt : int, another one has other sweeps and other noise
        """
        return self._log([self._from_home(self._sweeps(minutes, salt), session, SETTLED)], salt)

    def after_hours(
        self, hours: Sequence[float], minutes: float, payload: float | None, *, idle: bool
    ) -> CalibrationLog:
        """Return the same random run after each number of hours of use or of idling.

        Parameters
        ----------
        hours : sequence of float
        minutes : float, of each run
        payload : float or None, kg at the tool
        idle : bool, whether the arm idled meanwhile; idling changes nothing, by assumption
        """
        motion = self._sweeps(minutes, 40)
        starts = [SETTLED + (0.0 if idle else 3600.0 * h) for h in hours]
        return self._log([self._from_home(motion, 0, start, payload) for start in starts], 40)

    def _from_home(self, q: FloatArray, session: int = 0, start: float = 0.0, payload: float | None = None) -> Segment:
        """Drive there from where every homing ends, as on the real machine: cables remember where they were held."""
        approach = timed(np.stack([HOME, q[0]]), SPEED, self._rate()).q[:-1]
        labels = np.repeat([NOT_LOGGED, 0], [len(approach), len(q)])
        return Segment(np.concatenate([approach, q]), labels, session, start, payload)

    def _sweeps(self, minutes: float, salt: int) -> FloatArray:
        rng = np.random.default_rng([self.seed, salt])
        return random_sweeps(TEST_LIMITS, SLOW, FAST, 60.0 * minutes, self._rate(), rng).q

    def _log(self, paths: Sequence[Segment], salt: int) -> CalibrationLog:
        """Record the paths, a trajectory each; the study has outside encoders only, and no tracker."""
        machine = machine_of(self._model(loaded=any(path.payload is not None for path in paths)))
        numbered = [replace(p, trajectory=np.where(p.trajectory < 0, NOT_LOGGED, k)) for k, p in enumerate(paths)]
        log = simulate(machine, plan_of(numbered, machine.log_rate_hz), self.seed * 100_000 + salt)
        return replace(log, tracker_cp=None, setpoint_cp=None, measured_cp=None)

    def _model(self, *, loaded: bool) -> Model:
        """Return the machine, homed anew for each session; under load its cables drift faster."""
        model = self.machine or preset(PRESET)
        rng = np.random.default_rng([self.seed, 1])
        homed, drifts, others = [], [], []
        for effect in model.effects:
            if isinstance(effect, HomingOffset):
                first = float(np.atleast_1d(effect.offset)[0])
                shifts = HOMING_SPREAD[effect.joint] * rng.standard_normal(self.homings)
                homed.append(HomingOffset(effect.joint, (first, *(first + shifts).tolist())))
            elif isinstance(effect, Drift):
                drifts.append(replace(effect, rate=LOADED_DRIFT * effect.rate) if loaded else effect)
            else:
                others.append(effect)
        return model.with_effects(*homed, *drifts, *others)

    def _rate(self) -> float:
        return float(preset(PRESET).log_rate_hz)


def whole_state(log: CalibrationLog, seed: int = 0) -> CalibrationLog:
    """Add every column of a RAVEN-II's state message that a simulation can fill.

    The message repeats what joints and efforts say: motor positions, encoder counts, amplifier counts, reported poses,
    speeds, of the desired and the reported motion, and all of it once more for the arm that rests. Counters and clocks
    are left out: they tell the time, which no calibration may learn.

    Parameters
    ----------
    log : CalibrationLog, with `measured_jp`, `setpoint_jp` and `measured_jf` of the first three joints
    seed : int, of the resting arm's jitter

    Returns
    -------
    CalibrationLog
        With the columns `state_0`, `state_1`, ... among the extra ones.
    """
    assert log.measured_jp is not None
    assert log.setpoint_jp is not None
    assert log.measured_jf is not None
    arm = arm_named(ARM)
    assert arm.transmission is not None
    q, desired, effort = (all_joints(signal) for signal in (log.measured_jp, log.setpoint_jp, log.measured_jf))
    columns = []
    for joints in (q, desired):  # the message gives positions in whole micrometres
        T = arm.forward(joints)
        columns += [np.round(T[:, :3, 3] / 1e-6), T[:, :3, :3].reshape(len(T), 9)]
    motors, wanted = (arm.transmission.motor_from_joint(joints) for joints in (q, desired))
    amplifier = np.round(arm.transmission.motor_torque(effort) * AMPLIFIER_COUNTS)
    columns += [motors, wanted, np.round(motors * COUNTS_PER_RAD), amplifier]
    velocity = all_joints(np.gradient(log.measured_jp, axis=0) / np.gradient(log.time)[:, None])
    twist = np.einsum("nij,nj->ni", arm.chain.jacobian(q), velocity)
    moving = np.hstack([*columns, arm.transmission.motor_from_joint(velocity), twist])
    resting = RESTING_JITTER * np.random.default_rng(seed).standard_normal(moving.shape)
    named = {f"state_{i}": column for i, column in enumerate(np.hstack([moving, resting]).T)}
    return replace(log, extra={**log.extra, **named})


def all_joints(first_three: FloatArray) -> FloatArray:
    """Values `(n, 6)` of all joints from those `(n, 3)` of the first three; the tool's own are at rest.

    Parameters
    ----------
    first_three : (n, 3) array
    """
    return np.hstack([first_three, np.zeros((len(first_three), 3))])
