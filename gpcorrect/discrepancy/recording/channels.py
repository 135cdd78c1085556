"""What a recording is compared in."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Channel:
    """One compared signal.

    Parameters
    ----------
    name : str
        Signal and joint or axis, such as "external_jp_2".
    signal : str
        Log signal; the tracker's orientation counts as one of its own, "tracker_rotation".
    index, joint : int
        Column among the model's joints and number of the joint; axis of the tracker, and 0.
    unit : str
        "rad" or "m".
    """

    name: str
    signal: str
    index: int
    joint: int
    unit: str
