"""What cleaning may be told; every default is explained beside it."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from gpcorrect.cleaning.segments import Segment
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray

__all__ = ["CleaningSettings"]

MIN_FIELD_SAMPLES = 50


@dataclass(frozen=True)
class CleaningSettings:
    """Limits and factors of the cleaning rules; metres, radians, seconds.

    Parameters
    ----------
    trajectory_share : float
        P: a trajectory with a larger share of rejected samples is dropped whole (Mahler 2014, Sec. IV-A: 90 %).
    max_rotation : float
        Physical limit on the angle between observed and commanded orientation. Cable-driven wrists miss by up to 30
        degrees; the default is twice that.
    workspace_margin : float
        How far outside the box of commanded positions the arm can be. Errors reach several centimetres.
    max_speed, max_angular_speed : float or None
        Physical limits on observed motion, m/s and rad/s. None takes `speed_factor` times the fastest command.
    speed_factor : float
        See above: an arm on cables overshoots and springs back faster than it is commanded.
    outlier_factor : float
        Robust scales from the rigid model beyond which a sample is a gross outlier whatever surrounds it. Systematic
        errors are bounded and fill their scale, so their largest stay well below.
    step_factor : float
        Robust scales of the sample-to-sample noise that a step of the error may have.
    follow_factor : float
        Times the commanded travel that a step of the error may have besides: 1 is an arm that stands still while it is
        commanded to move (friction, play); one that catches up moves faster than commanded.
    response_time : float
        The arm follows its command within this time, so the commanded travel is the largest of this neighbourhood.
    occlusion_time : float
        Longest occlusion, s, that is told from a real step of the error (which lasts) by its length alone.
    offset_factor : float
        Robust scales from the smooth model of the error beyond which a sample is rejected.
    frozen_travel : float
        Commanded travel, m, during which the observation may repeat itself exactly.
    position_resolution, rotation_resolution : float
        Deviations below these are never faults: a floor under every learned scale.
    field_samples : int
        Samples that the smooth model of the error is learned from (time grows with the cube).
    keep, drop : tuple of Segment
        Segments that are kept or dropped by hand; they beat every rule, and `keep` beats `drop`.

    Raises
    ------
    DataError
        A number out of range.
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
            if isinstance(value, int | float) and not 0 < value < np.inf:
                raise DataError(f"cleaning setting {field.name} must be positive and finite, got {value}.")
        if self.trajectory_share > 1:
            raise DataError(f"trajectory_share is at most 1, got {self.trajectory_share}.", hint="For 90 % give 0.9.")
        if self.field_samples < MIN_FIELD_SAMPLES:
            raise DataError(f"field_samples must be at least {MIN_FIELD_SAMPLES}, got {self.field_samples}.")
        object.__setattr__(self, "keep", tuple(self.keep))
        object.__setattr__(self, "drop", tuple(self.drop))

    @property
    def resolution(self) -> FloatArray:
        """(2,) smallest deviation that can be a fault, m and rad."""
        return np.array([self.position_resolution, self.rotation_resolution])

    def to_dict(self) -> dict[str, Any]:
        """Return the settings as JSON-able values."""
        by_hand = {name: [s.to_dict() for s in getattr(self, name)] for name in ("keep", "drop")}
        return {**asdict(self), **by_hand}
