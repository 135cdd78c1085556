"""Settings of cleaning, each explained beside its default, and segments that a person keeps or drops."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray

MIN_FIELD_SAMPLES = 50  # five for each of the ten folds that the smooth model is checked on


@dataclass(frozen=True)
class Segment:
    """A stretch of one trajectory, both ends included.

    Parameters
    ----------
    trajectory : int, number of the trajectory
    start, stop : float, first and last time, s; infinite for an open end; DataError where `stop` is first
    """

    trajectory: int
    start: float = -np.inf
    stop: float = np.inf

    def __post_init__(self) -> None:
        if not self.start <= self.stop:
            raise DataError(
                f"a segment runs forward in time, got {self.start} s to {self.stop} s.",
                hint="Give trajectory, start and stop, in seconds of the log's clock.",
            )


def require_segments(log: CalibrationLog, segments: Iterable[Segment]) -> None:
    """Refuse segments that no sample of the log lies in: a person meant something by them.

    Parameters
    ----------
    log : CalibrationLog, recording to be cleaned
    segments : iterable of Segment, stretches to keep or drop

    Raises
    ------
    DataError
        There is no such trajectory, or it has no sample at these times.
    """
    for segment in segments:
        rows = log.trajectory == segment.trajectory
        if not rows.any():
            ids = log.trajectory_ids
            raise DataError(
                f"a segment names trajectory {segment.trajectory}, which is not in the log.",
                hint=f"It has {len(ids)}, numbered from {ids.min()} to {ids.max()}.",
            )
        if not segment_mask(log, [segment]).any():
            low, high = log.time[rows].min(), log.time[rows].max()
            raise DataError(
                f"trajectory {segment.trajectory} has no sample from {segment.start:g} to {segment.stop:g} s.",
                hint=f"That trajectory runs from {low:g} s to {high:g} s of the log's clock.",
            )


def segment_mask(log: CalibrationLog, segments: Iterable[Segment]) -> BoolArray:
    """Return the mask (n,) of samples that lie in any of the segments.

    Parameters
    ----------
    log : CalibrationLog, n samples
    segments : iterable of Segment, stretches of it
    """
    mask = np.zeros(len(log), dtype=bool)
    for segment in segments:
        mask |= (log.trajectory == segment.trajectory) & (log.time >= segment.start) & (log.time <= segment.stop)
    return mask


@dataclass(frozen=True)
class CleaningSettings:
    """Limits and factors of the cleaning rules; metres, radians, seconds.

    Defaults without a source were chosen by hand on simulated recordings with planted faults
    (`bench/cleaning_faults.py` prints what they find and what they cost).

    Parameters
    ----------
    trajectory_share : float
        P: a trajectory with a larger fraction of rejected samples is dropped whole (Mahler 2014, Sec. IV-A: 90 %).
    max_rotation : float
        Physical limit on the angle between observed and commanded orientation, or on the error of a revolute joint.
        Cable-driven wrists miss by up to 30 degrees; the default is twice that.
    workspace_margin : float
        How far outside the box of commanded positions the tool, or a prismatic joint, can be. Errors reach several
        centimetres.
    max_speed, max_angular_speed : float or None
        Physical limits on observed motion, m/s and rad/s. None takes `speed_factor` times the fastest command.
    speed_factor : float, see above: an arm on cables overshoots and springs back faster than it is commanded
    outlier_factor : float
        Robust scales from the registration beyond which a sample is a gross outlier whatever surrounds it. Systematic
        errors are bounded and fill their scale, so their largest stay well below.
    step_factor : float, robust scales of the sample-to-sample noise that a step of the error may have
    follow_factor : float
        Times the commanded travel that a step of the error may have besides: 1 is an arm that stands still while it is
        commanded to move (friction, play); one that catches up moves faster than commanded.
    response_time : float
        The arm follows its command within this time, so the commanded travel is the largest of this neighbourhood.
    occlusion_time : float
        Longest occlusion, s, that differs from a real step of the error (which lasts) by its length alone.
    offset_factor : float, robust scales from the smooth model of the error beyond which a sample is rejected
    frozen_travel : float, commanded travel, m, during which the observation may repeat itself exactly
    position_resolution, rotation_resolution : float
        Deviations below these are never faults: a floor under every learned scale.
    field_samples : int, samples that the smooth model of the error is learned from (time grows with the cube)
    keep, drop : tuple of Segment, segments to keep or to drop by hand; they beat every rule, and `keep` beats `drop`

    Raises
    ------
    DataError
        A number out of range, or what is no number; or a segment that is none.
    """

    trajectory_share: float = 0.9
    max_rotation: float = float(np.radians(60.0))
    workspace_margin: float = 0.1
    max_speed: float | None = None
    max_angular_speed: float | None = None
    speed_factor: float = 4.0
    outlier_factor: float = 8.0
    step_factor: float = 6.0
    follow_factor: float = 1.5
    response_time: float = 0.2
    occlusion_time: float = 0.4
    offset_factor: float = 6.0
    frozen_travel: float = 0.002
    position_resolution: float = 1e-4
    rotation_resolution: float = 1e-3
    field_samples: int = 800
    keep: tuple[Segment, ...] = ()
    drop: tuple[Segment, ...] = ()

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in ("keep", "drop"):
                by_hand = tuple(value) if isinstance(value, Iterable) else (None,)
                if not all(isinstance(segment, Segment) for segment in by_hand):
                    raise DataError(f"cleaning setting {field.name} holds segments, got {value!r}.")
                object.__setattr__(self, field.name, by_hand)
            elif not (value is None and field.default is None):
                number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
                if not (number and 0 < float(value) < np.inf):
                    name = field.name
                    raise DataError(f"cleaning setting {name} must be a number, positive and finite, got {value!r}.")
        if not isinstance(self.field_samples, int | np.integer):
            raise DataError(f"field_samples is a whole number, got {self.field_samples!r}.")
        if self.trajectory_share > 1:
            raise DataError(f"trajectory_share is at most 1, got {self.trajectory_share}.", hint="For 90 % give 0.9.")
        if self.field_samples < MIN_FIELD_SAMPLES:
            raise DataError(f"field_samples must be at least {MIN_FIELD_SAMPLES}, got {self.field_samples}.")

    def resolution(self, units: str) -> FloatArray:
        """Return the smallest deviation (g,) that can be a fault.

        Parameters
        ----------
        units : str, "P" (m) or "R" (rad) for each of g groups
        """
        return np.array([self.position_resolution if unit == "P" else self.rotation_resolution for unit in units])
