"""Why a sample is rejected: the codes, a sentence each, and the unit of the value that broke the limit."""

from __future__ import annotations

from enum import StrEnum

__all__ = ["Reason"]


class Reason(StrEnum):
    """Code of a rejection; :attr:`sentence` says it in words, :attr:`unit` is that of value and limit.

    Codes are listed in the order in which they are asked: a sample carries the first that applies.
    """

    INVALID = "invalid"
    WORKSPACE = "workspace"
    ROTATION = "rotation"
    FROZEN = "frozen"
    OUTLIER = "outlier"
    SPEED = "speed"
    ANGULAR_SPEED = "angular_speed"
    JUMP = "jump"
    OFFSET = "offset"
    SURROUNDED = "surrounded"
    TRAJECTORY = "trajectory"
    MANUAL = "manual"

    @property
    def sentence(self) -> str:
        """What happened, for a reader of the report."""
        return _SENTENCES[self]

    @property
    def unit(self) -> str:
        """Unit of the measured value and of the limit that it broke."""
        return _UNITS[self]


_SENTENCES = {
    Reason.INVALID: "a number is missing, or the norm of a quaternion is not 1.",
    Reason.WORKSPACE: "the observed position lies outside the commanded workspace and its margin.",
    Reason.ROTATION: "the observed orientation is turned from the commanded one by more than the arm can err.",
    Reason.FROZEN: "the observation stood still while the command travelled.",
    Reason.OUTLIER: "the pose lies too many robust scales away from the rigid model.",
    Reason.SPEED: "the sample lies between position steps that the arm is too slow for.",
    Reason.ANGULAR_SPEED: "the sample lies between rotation steps that the arm is too slow for.",
    Reason.JUMP: "the error jumps on entering or leaving the sample's piece, by more than noise and motion explain.",
    Reason.OFFSET: "the error differs from what poses and velocities like this one show elsewhere in the recording.",
    Reason.SURROUNDED: "most samples right before and after it were rejected, so it is no part of a motion.",
    Reason.TRAJECTORY: "nearly all samples of its trajectory were rejected, so the whole of it is.",
    Reason.MANUAL: "a segment dropped by hand.",
}

_UNITS = {
    Reason.INVALID: "bad numbers",
    Reason.WORKSPACE: "m",
    Reason.ROTATION: "rad",
    Reason.FROZEN: "m",
    Reason.OUTLIER: "robust scales",
    Reason.SPEED: "m/s",
    Reason.ANGULAR_SPEED: "rad/s",
    Reason.JUMP: "times the largest plausible step",
    Reason.OFFSET: "robust scales",
    Reason.SURROUNDED: "share rejected",
    Reason.TRAJECTORY: "share rejected",
    Reason.MANUAL: "",
}
