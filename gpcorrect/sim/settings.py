"""Tables of a model file that the simulator uses as they are: frozen, typed, an unknown key is an error."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
NonNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]
Fraction = Annotated[float, Field(strict=True, ge=0, lt=1)]


class Settings(BaseModel):
    """A table of a model file; a key that it does not have is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Noise(Settings):
    """Standard deviations of the sensors' noise; zero, or nothing, is none.

    Parameters
    ----------
    external_jp_white, external_jp_ar_std : tuples of float
        White and AR part on the outside joint sensors, for each joint, rad or m.
    external_jp_ar_phi, tracker_ar_phi : float, correlation of the AR parts from one sample to the next
    tracker_white, tracker_ar_std : float, on each axis of the tracked position, m
    tracker_rotation_white, tracker_rotation_ar_std : float, on each axis of the tracked orientation, rad
    encoder_step : tuple of float, resolution of the motor encoders at the joint, rad or m
    """

    external_jp_white: tuple[NonNegative, ...] = ()
    external_jp_ar_std: tuple[NonNegative, ...] = ()
    external_jp_ar_phi: Fraction = 0.95
    tracker_white: NonNegative = 0.0
    tracker_ar_std: NonNegative = 0.0
    tracker_ar_phi: Fraction = 0.95
    tracker_rotation_white: NonNegative = 0.0
    tracker_rotation_ar_std: NonNegative = 0.0
    encoder_step: tuple[NonNegative, ...] = ()


class TrackerFaults(Settings):
    """How often the tracker fails, and how badly; all zero is never.

    Parameters
    ----------
    lost_share : float
        Fraction of the recording, in one block, in which a fiducial is lost and the pose is solved from the others.
    lost_shift, lost_turn : float, how far the pose is then off, m and rad
    jumps_hz : float, occlusions a second: the pose jumps away and back, with false velocities at both ends
    jump_seconds, jump_shift, jump_turn : float, their mean duration, and how far the pose jumps, s, m and rad
    outlier_share, outlier_shift, outlier_turn : float
        Fraction of single samples that are grossly wrong, and the standard deviation of their error on each axis.
    flip_share : float
        Fraction of single samples whose orientation is mirrored to the other solution: half a turn about a body axis.
    dropout_share : float, fraction of samples that are missing, singly or a few in a row
    """

    lost_share: Fraction = 0.0
    lost_shift: NonNegative = 0.05
    lost_turn: NonNegative = 0.7
    jumps_hz: NonNegative = 0.0
    jump_seconds: Positive = 0.08
    jump_shift: NonNegative = 0.03
    jump_turn: NonNegative = 0.3
    outlier_share: Fraction = 0.0
    outlier_shift: NonNegative = 0.1
    outlier_turn: NonNegative = 1.0
    flip_share: Fraction = 0.0
    dropout_share: Fraction = 0.0
