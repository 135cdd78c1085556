"""What a recording is compared in."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Channel:
    """One compared signal, by its name, such as "external_jp_2", and unit, "rad" or "m".

    The tracker's orientation counts as a signal of its own, "tracker_rotation". `index` is the column among the model's
    joints, `joint` its number; of a tracker, the axis and 0.
    """

    name: str
    signal: str
    index: int
    joint: int
    unit: str
