"""How far each camera is trusted with each ball: effective, or suspended with the reason, and back after good frames.

Peng et al. 2020: a circle that jumps, has the wrong colour or is not found is suspended; five good frames that agree
with the other cameras bring it back. While fewer than two cameras see a ball the search widens, and narrows again.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from gpcorrect.vision.rim import Outline

__all__ = ["REASONS", "BallMemory", "FrameRules", "Reason", "View"]

Reason = Literal["", "not found", "moved too far", "wrong size", "against the other cameras", "coming back"]
REASONS: tuple[Reason, ...] = (
    "",
    "not found",
    "moved too far",
    "wrong size",
    "against the other cameras",
    "coming back",
)


@dataclass(frozen=True)
class FrameRules:
    """When a view is suspended, and how it comes back.

    Parameters
    ----------
    motion_px : float
        Farther than this from where the prediction puts it, a circle is not the ball; times the tolerance.
    radius : float
        Share by which the outline may be larger or smaller than predicted.
    reprojection_px : float
        Farther than this from what the other cameras say, a view is suspended.
    good_frames : int
        Agreeing frames that bring a view back.
    widen, widest : float
        Factor a frame by which the tolerance grows while fewer than two cameras see a ball, and its limit.
    patience : int
        Frames between two searches of whole pictures, which take long, while the tool is not found.
    """

    motion_px: float = 16.0
    radius: float = 0.25
    reprojection_px: float = 1.5
    good_frames: int = 5
    widen: float = 1.5
    widest: float = 6.0
    patience: int = 5


@dataclass
class View:
    """One ball in one camera, from frame to frame."""

    effective: bool = False
    reason: Reason = "not found"
    good: int = 0
    outline: Outline | None = None

    def suspend(self, reason: Reason) -> None:
        """Trust this view no more, until it has been good for long enough."""
        self.effective, self.reason, self.good = False, reason, 0

    def admit(self) -> None:
        """Trust this view."""
        self.effective, self.reason = True, ""

    def count_good(self, needed: int) -> None:
        """One more frame in which a suspended view agreed with the others."""
        self.good += 1
        self.reason = "coming back"
        if self.good >= needed:
            self.admit()


@dataclass
class BallMemory:
    """What is known of a ball from earlier frames: its size, and how wide to search."""

    radius: float | None = None
    tolerance: float = 1.0
    sizes: list[float] = field(default_factory=list)

    def learn_size(self, radius: float, keep: int = 60) -> None:
        """Take in a radius (m) as one frame tells it; the median of the last ones counts."""
        self.sizes = [*self.sizes[-keep:], radius]
        self.radius = float(np.median(self.sizes))

    def seen_by(self, cameras: int, rules: FrameRules) -> None:
        """Widen the search while fewer than two cameras see the ball, narrow it again otherwise."""
        factor = rules.widen if cameras < 2 else 1.0 / rules.widen
        self.tolerance = float(np.clip(self.tolerance * factor, 1.0, rules.widest))
