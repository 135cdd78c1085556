"""What sensors say of a machine that runs live: encoders' steps and noise, outside encoders, and a tracker."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect import se3
from gpcorrect.sim.effects import ReadingEffect, of_kind
from gpcorrect.sim.live import Moment
from gpcorrect.sim.machine import Machine
from gpcorrect.sim.motion import Readings
from gpcorrect.sim.sensors import quantised
from gpcorrect.types import FloatArray

__all__ = ["LiveSensors", "LiveTracker", "Reading"]


@dataclass(frozen=True, eq=False)
class Reading:
    """What is known of the arm at one instant.

    Parameters
    ----------
    time : float
        Session time, s.
    position, velocity, effort : (dof,) arrays
        As the robot reports them, rad or m.
    external : (dof,) array
        True joints as outside encoders see them.
    tracker : (4, 4) array or None
        Marker pose in the tracker's frame; None for bare joints, and where the tracker was not asked.
    """

    time: float
    position: FloatArray
    velocity: FloatArray
    effort: FloatArray
    external: FloatArray
    tracker: FloatArray | None


class _Slow:
    """First-order autoregressive noise whose memory is told in seconds, so that it may be asked at any rate.

    Parameters
    ----------
    std : (d,) array
        Stationary standard deviation.
    phi : float
        Correlation from one log sample to the next.
    rate_hz : float
        Log samples a second.
    """

    def __init__(self, std: FloatArray, phi: float, rate_hz: float) -> None:
        self._std, self._phi, self._rate = std, phi, rate_hz
        self._state: FloatArray | None = None
        self._time = 0.0

    def at(self, time: float, rng: np.random.Generator) -> FloatArray:
        """Return the noise at a time not before the last one, s."""
        fresh = rng.standard_normal(self._std.shape)
        if self._state is None:
            self._state = fresh
        else:
            kept = self._phi ** ((time - self._time) * self._rate) if self._phi > 0 else 0.0
            self._state = kept * self._state + np.sqrt(max(0.0, 1.0 - kept**2)) * fresh
        self._time = time
        noise: FloatArray = self._std * self._state
        return noise


class LiveTracker:
    """A tracker without occlusions: the machine's white and slow noise on the marker's pose.

    Parameters
    ----------
    machine : Machine
    rng : numpy.random.Generator
    """

    def __init__(self, machine: Machine, rng: np.random.Generator) -> None:
        noise = machine.noise
        std = np.array([*[noise.tracker_ar_std] * 3, *[noise.tracker_rotation_ar_std] * 3])
        self._white = np.array([*[noise.tracker_white] * 3, *[noise.tracker_rotation_white] * 3])
        self._slow = _Slow(std, noise.tracker_ar_phi, machine.log_rate_hz)
        self._machine, self._rng = machine, rng

    def see(self, moment: Moment) -> FloatArray:
        """Return the marker's pose `(4, 4)` in the tracker's frame."""
        assert moment.T_base_tip is not None
        T = se3.compose(self._machine.T_tracker_base, moment.T_base_tip, self._machine.T_tip_marker)
        noise = self._slow.at(moment.time, self._rng) + self._white * self._rng.standard_normal(6)
        return se3.pose(T[:3, :3] @ se3.matrix_from_rotvec(noise[3:]), T[:3, 3] + noise[:3])


class LiveSensors:
    """Everything that is measured on a live arm.

    Parameters
    ----------
    machine : Machine
    rng : numpy.random.Generator
    """

    def __init__(self, machine: Machine, rng: np.random.Generator) -> None:
        dof, noise = len(machine.body.joints), machine.noise
        self._machine, self._rng = machine, rng
        self._tracker = None if machine.body.chain is None else LiveTracker(machine, rng)
        self._white = np.broadcast_to(np.asarray(noise.external_jp_white or 0.0, dtype=np.float64), (dof,))
        slow = np.broadcast_to(np.asarray(noise.external_jp_ar_std or 0.0, dtype=np.float64), (dof,))
        self._slow = _Slow(slow, noise.external_jp_ar_phi, machine.log_rate_hz)
        self._effects = of_kind(machine.effects, ReadingEffect)

    def read(self, moment: Moment, *, tracked: bool = True) -> Reading:
        """Return what is measured at a moment, with or without the tracker, which takes longest."""
        motion = moment.motion
        marker = None if self._tracker is None or not tracked else self._tracker.see(moment)[None, None]
        readings = Readings(motion.position, motion.velocity, moment.torque[None, None], moment.q[None, None], marker)
        for effect in self._effects:
            readings = effect.act(readings, motion, self._rng)
        external = readings.external_jp[0, 0] + self._slow.at(moment.time, self._rng)
        seen = readings.T_tracker_marker
        return Reading(
            time=moment.time,
            position=quantised(readings.measured_jp, self._machine.noise.encoder_step)[0, 0],
            velocity=readings.measured_jv[0, 0],
            effort=readings.measured_jf[0, 0],
            external=external + self._white * self._rng.standard_normal(external.shape),
            tracker=None if seen is None else seen[0, 0],
        )
