"""What an arm can do from one sample to another: limits on its speed and on steps of its error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol, Self

import numpy as np
from scipy.ndimage import maximum_filter1d

from gpcorrect.cleaning.lmeds import robust_scale
from gpcorrect.cleaning.reasons import Reason
from gpcorrect.cleaning.samples import Samples, part_norms, rotation_angles
from gpcorrect.cleaning.settings import CleaningSettings
from gpcorrect.cleaning.smooth import SecondLook
from gpcorrect.types import FloatArray, IntArray, frozen_array

__all__ = ["ErrorStepLimit", "Path", "SpeedLimit", "StepLimit", "StepRuler", "commanded_speeds"]

FAST_QUANTILE = 0.999  # the fastest command, but for the odd sample of a setpoint that steps
SLOWEST = np.array([0.05, np.radians(30.0)])  # m/s, rad/s: below these no speed of an arm is impossible
SPEED_REASONS = (Reason.SPEED, Reason.ANGULAR_SPEED)


@dataclass(frozen=True, eq=False)
class Path:
    """Samples and how far they were commanded to travel.

    Parameters
    ----------
    samples : Samples
        n samples.
    error : (n, k) array
        Their error, or what a smooth model leaves of it, m and rad.
    travel : (n, parts) array
        Commanded travel since the first sample, m and rad, at the largest speed of each sample's neighbourhood: what
        an arm that follows late can have moved.
    """

    samples: Samples
    error: FloatArray
    travel: FloatArray

    @classmethod
    def of(cls, samples: Samples, error: FloatArray, response_time: float) -> Self:
        """Path of samples whose arm follows within `response_time` seconds."""
        speed, dt = commanded_speeds(samples)
        if not len(dt):
            return cls(samples, error, np.zeros((len(samples), speed.shape[1])))
        width = 2 * int(np.clip(np.ceil(response_time / max(np.median(dt), 1e-9)), 1, len(dt))) + 1
        steps = maximum_filter1d(speed, width, axis=0, mode="nearest") * dt[:, None]
        return cls(samples, error, np.concatenate([np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)]))


class StepLimit(Protocol):
    """Something no working arm and tracker exceed between two samples."""

    @property
    def reason(self) -> Reason:
        """Code of a breach."""
        ...

    @property
    def limit(self) -> float:
        """Largest value that is possible, in the reason's unit."""
        ...

    def ratio(self, path: Path, i: IntArray, j: IntArray) -> FloatArray:
        """Step (m,) from samples i to later samples j, as a multiple of the largest that is possible."""
        ...


@dataclass(frozen=True)
class SpeedLimit:
    """The observation moves at most at `limit` m/s (part 0) or rad/s (part 1), beyond the step `noise` can feign."""

    part: int
    limit: float
    noise: float

    @property
    def reason(self) -> Reason:
        """Code of a breach."""
        return SPEED_REASONS[self.part]

    def ratio(self, path: Path, i: IntArray, j: IntArray) -> FloatArray:
        """Observed speed over the limit."""
        mapped, time = path.samples.mapped, path.samples.time
        if self.part == 0:
            step = np.linalg.norm(mapped.position[j] - mapped.position[i], axis=1)
        else:
            step = rotation_angles(mapped.quaternion[i], mapped.quaternion[j])  # type: ignore[index]
        ratio: FloatArray = np.maximum(step - self.noise, 0.0) / (time[j] - time[i]) / self.limit
        return ratio


@dataclass(frozen=True)
class ErrorStepLimit:
    """The error changes by at most `noise` plus `follow` times the commanded travel (m for part 0, rad for part 1).

    However far the travel, two errors differ by no more than `cap`. An arm that sticks while commanded to move, or
    springs back, changes its error no faster than that; a marker that is lost, occluded or mistaken for another does.
    """

    part: int
    noise: float
    follow: float
    cap: float
    reason: ClassVar[Reason] = Reason.JUMP
    limit: ClassVar[float] = 1.0

    def ratio(self, path: Path, i: IntArray, j: IntArray) -> FloatArray:
        """Step of the error over the largest that noise and travel explain."""
        columns = slice(3 * self.part, 3 * self.part + 3)
        step = np.linalg.norm(path.error[j, columns] - path.error[i, columns], axis=1)
        travel = np.abs(path.travel[j, self.part] - path.travel[i, self.part])
        plausible = np.maximum(np.minimum(self.noise + self.follow * travel, self.cap), self.noise)
        ratio: FloatArray = step / plausible
        return ratio


def commanded_speeds(samples: Samples) -> tuple[FloatArray, FloatArray]:
    """Commanded speeds (n - 1, parts), m/s and rad/s, from sample to sample, 0 across runs, and steps (n - 1,), s."""
    command, dt = samples.command, np.diff(samples.time)
    steps = [np.linalg.norm(np.diff(command.position, axis=0), axis=1)]
    if samples.error.shape[1] > 3 and command.quaternion is not None:
        steps.append(rotation_angles(command.quaternion[:-1], command.quaternion[1:]))
    inside = samples.run[1:] == samples.run[:-1]
    dt = np.where(inside, dt, 0.0)
    speed: FloatArray = np.stack(steps, axis=1) / np.where(inside, dt, np.inf)[:, None]
    return speed, dt


@dataclass(frozen=True, eq=False)
class StepRuler:
    """What limits on steps are learned: from training data, for any other data of the same arm and tracker.

    Parameters
    ----------
    noise : (parts,) array
        Largest step of the error that noise makes, m and rad.
    speeds : (parts,) array
        Largest observed speed, m/s and rad/s.
    follow : float
        Times the commanded travel that the error may step besides.
    cap : (parts,) array
        Largest difference of any two errors, m and rad.
    """

    noise: FloatArray
    speeds: FloatArray
    follow: float
    cap: FloatArray

    @classmethod
    def learn(cls, samples: Samples, look: SecondLook, settings: CleaningSettings) -> Self:
        """Noise from the median step of the error, speeds from the settings or the fastest commands.

        Parameters
        ----------
        samples : Samples
            Training samples, faults among them.
        look : SecondLook
            How they look beside the smooth model.
        settings : CleaningSettings
            Factors, floors, and speeds if given.
        """
        inside = samples.run[1:] == samples.run[:-1]
        steps = part_norms(np.diff(look.remainder, axis=0)[inside])
        parts = steps.shape[1]
        noise = settings.resolution[:parts]
        fastest = np.zeros(parts)
        if len(steps):
            noise = np.maximum(robust_scale(steps, 3), noise)
            fastest = np.quantile(commanded_speeds(samples)[0][inside], FAST_QUANTILE, axis=0)
        given = (settings.max_speed, settings.max_angular_speed)
        derived = np.maximum(settings.speed_factor * fastest, SLOWEST[:parts])
        speeds = [float(own) if said is None else said for own, said in zip(derived, given, strict=False)]
        return cls(
            noise=frozen_array(settings.step_factor * noise),
            speeds=frozen_array(speeds),
            follow=settings.follow_factor,
            cap=frozen_array(settings.step_factor * np.sqrt(2.0) * look.scale),
        )

    @property
    def limits(self) -> list[StepLimit]:
        """The limits, ready to be asked; speeds first, since a sample names the first that it breaks most."""
        parts = range(len(self.noise))
        return [
            *(SpeedLimit(part, float(self.speeds[part]), float(self.noise[part])) for part in parts),
            *(ErrorStepLimit(part, float(self.noise[part]), self.follow, float(self.cap[part])) for part in parts),
        ]
