"""How sure a correction must be before a robot acts on it without looking."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from gpcorrect.planning.correction import CommandPath
from gpcorrect.types import FloatArray

__all__ = ["Doubt", "Margins"]

Cause = Literal["out of domain", "position interval", "rotation interval"]


@dataclass(frozen=True)
class Doubt:
    """Why a path is not trusted.

    Parameters
    ----------
    cause : str
        What went beyond its margin.
    value, allowed : float
        How far, and how far it may: m, rad, or the share of poses out of domain.
    """

    cause: Cause
    value: float
    allowed: float

    def __str__(self) -> str:
        match self.cause:
            case "out of domain":
                return f"{100 * self.value:.0f} % of the poses are out of domain"
            case "position interval":
                return f"the tool's place is known to {1e3 * self.value:.1f} mm, {1e3 * self.allowed:.1f} mm are needed"
            case "rotation interval":
                known, needed = np.rad2deg([self.value, self.allowed])
                return f"the tool's turn is known to {known:.1f} deg, {needed:.1f} deg are needed"


@dataclass(frozen=True)
class Margins:
    """What must hold where the tool arrives, where a mistake matters; on the way there only the domain is looked at.

    Parameters
    ----------
    position : float
        Largest half width of the 95 % interval along any axis at the goal, m.
    rotation : float
        The same for the rotation, rad.
    outside : float
        Largest share of a path's poses that may lie out of domain; the goal itself never may.
    """

    position: float = 0.004
    rotation: float = np.deg2rad(12.0)
    outside: float = 0.5

    def doubt(self, command: CommandPath) -> Doubt | None:
        """Return the first reason not to trust a command, or None."""
        outside = 1.0 - float(np.mean(command.in_domain))
        if outside > self.outside or not command.in_domain[-1]:
            return Doubt("out of domain", outside, self.outside)
        position, rotation = (self._widest(part) for part in np.split(command.interval95[-1], 2))
        if position > self.position:
            return Doubt("position interval", position, self.position)
        if rotation > self.rotation:
            return Doubt("rotation interval", rotation, self.rotation)
        return None

    @staticmethod
    def _widest(half_widths: FloatArray) -> float:
        """Return the widest; what was not learned is not known at all."""
        return float(np.where(np.isnan(half_widths), np.inf, half_widths).max())
