"""Recordings of the joint-level calibration study on the simulated RAVEN-II: zig-zags, hours of use, homings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.joint import direction_named, random_sweeps, timed, zigzag
from gpcorrect.sim import DrivenPath, Model, driven_log, preset
from gpcorrect.sim.effects.drift import Drift
from gpcorrect.sim.effects.homing_offset import HomingOffset
from gpcorrect.types import CalibrationLog, FloatArray

__all__ = ["RavenStudy"]

DEGREE = np.deg2rad(1.0)
LIMITS = np.array([[20 * DEGREE, 60 * DEGREE], [55 * DEGREE, 110 * DEGREE], [0.33, 0.42]])
# Speeds of the study's public controller: of its trajectory follower, and of its random motion from and to.
SPEED = np.array([3 * DEGREE, 3 * DEGREE, 0.01])
SLOW, FAST = np.array([[1.1 * DEGREE, 1.5 * DEGREE, 0.0025], [2.2 * DEGREE, 3.0 * DEGREE, 0.005]])
TEST_LIMITS = LIMITS.mean(axis=1)[:, None] + np.ptp(LIMITS, axis=1)[:, None] * np.array([-0.3, 0.3])
HOME = np.array([30 * DEGREE, 90 * DEGREE, 0.40])
HOMING_SPREAD: dict[int | str, float] = {
    1: 0.1 * DEGREE,
    2: 0.3 * DEGREE,
    3: 1e-4,
}  # joint 2 moves most, as in the study
HOUR = 3600.0
SETTLED = 600.0  # s after a homing at which recordings are made
LOADED_DRIFT = 1.75  # over the unloaded one: for the study's two figures for joint 1 after six hours
ZIGZAG_SALT = 1000


@dataclass(frozen=True)
class RavenStudy:
    """The simulated arm and its seed.

    Parameters
    ----------
    seed : int
        Of noise, homings and random motion.
    homings : int
        Homings after the first.
    """

    seed: int = 0
    homings: int = 5

    def zigzags(
        self, direction: str, sparsity: int, *, sessions: Sequence[int] = (0,), repeat: int = 0
    ) -> CalibrationLog:
        """Return a zig-zag in each session, ten minutes after its homing; another repeat has other noise."""
        corners = zigzag(direction_named(direction), sparsity, LIMITS)
        path = timed(corners, SPEED, self._rate()).q
        return self._log([self._from_home(path, session, SETTLED) for session in sessions], ZIGZAG_SALT + repeat)

    def random_run(self, minutes: float, *, session: int = 0, salt: int = 2) -> CalibrationLog:
        """Return random sweeps inside the block that the zig-zags fill."""
        return self._log([self._from_home(self._sweeps(minutes, salt), session, SETTLED)], salt)

    def after_hours(
        self, hours: Sequence[float], minutes: float, payload: float | None, *, idle: bool
    ) -> CalibrationLog:
        """Return a random run after each number of hours of use, loaded or not, or of idling."""
        still = 0.0 if idle else 1.0
        motion = self._sweeps(minutes, 40)
        paths = [self._from_home(motion, 0, still * h * HOUR + SETTLED, payload) for h in hours]
        return self._log(paths, 40)

    def _from_home(
        self, q: FloatArray, session: int = 0, start: float = 0.0, payload: float | None = None
    ) -> DrivenPath:
        """Drive there from where every homing ends, as on the real machine: cables remember where they were held."""
        approach = timed(np.stack([HOME, q[0]]), SPEED, self._rate()).q[:-1]
        return DrivenPath(q, session, start, payload, approach)

    def _sweeps(self, minutes: float, salt: int) -> FloatArray:
        rng = np.random.default_rng([self.seed, salt])
        return random_sweeps(TEST_LIMITS, SLOW, FAST, 60.0 * minutes, self._rate(), rng).q

    def _log(self, paths: Sequence[DrivenPath], salt: int) -> CalibrationLog:
        loaded = any(path.payload is not None for path in paths)
        return driven_log(self._model(loaded=loaded), paths, self.seed * 100_000 + salt)

    def _model(self, *, loaded: bool) -> Model:
        """Return the machine, homed anew for each session; under load its cables settle faster."""
        model = preset("raven2_calibration")
        rng = np.random.default_rng([self.seed, 1])
        others = [e for e in model.effects if not isinstance(e, HomingOffset)]
        homed = []
        for effect in (e for e in model.effects if isinstance(e, HomingOffset)):
            first = float(np.atleast_1d(effect.offset)[0])
            shifts = HOMING_SPREAD[effect.joint] * rng.standard_normal(self.homings)
            homed.append(HomingOffset(effect.joint, (first, *(first + shifts).tolist())))
        drifts = [e for e in others if isinstance(e, Drift)]
        faster = [replace(e, rate=LOADED_DRIFT * e.rate) if loaded else e for e in drifts]
        return model.with_effects(*homed, *faster, *(e for e in others if not isinstance(e, Drift)))

    def _rate(self) -> float:
        return float(preset("raven2_calibration").log_rate_hz)
