"""How sure a correction must be before a robot acts on it without a camera, and the first path that is sure enough."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.planning.paths import CommandPath, Corrects, DesiredPath, Mode, corrected

Cause = Literal["out of domain", "cut", "position interval", "rotation interval"]


@dataclass(frozen=True)
class Doubt:
    """Why a path is not trusted.

    Parameters
    ----------
    cause : str, what went beyond its margin
    value, allowed : float, how far, and how far it may: m, rad, or the fraction of poses out of domain
    """

    cause: Cause
    value: float
    allowed: float

    def __str__(self) -> str:
        match self.cause:
            case "out of domain":
                return f"{100 * self.value:.0f} % of the poses are out of domain"
            case "cut":
                return "the command at the goal is not the whole correction: its status is not OK"
            case "position interval":
                return f"the tool's place is known to {1e3 * self.value:.1f} mm, {1e3 * self.allowed:.1f} mm are needed"
            case "rotation interval":
                known, needed = np.rad2deg([self.value, self.allowed])
                return f"the tool's turn is known to {known:.1f} deg, {needed:.1f} deg are needed"


@dataclass(frozen=True)
class Margins:
    """What must hold where the tool arrives, where a mistake matters; on the way there only the domain is checked.

    The defaults were chosen by hand for the debridement task: a gripper there catches within 5 mm and 25 degrees.

    Parameters
    ----------
    position : float, largest half width of the 95 % interval along any axis at the goal, m
    rotation : float, the same for the rotation, rad
    outside : float, largest fraction of a path's poses that may lie out of domain; the goal itself never may
    """

    position: float = 0.004
    rotation: float = np.deg2rad(12.0)
    outside: float = 0.5

    def __post_init__(self) -> None:
        if not (self.position > 0 and self.rotation > 0 and 0 <= self.outside <= 1):
            raise DataError(f"margins are lengths and angles above 0, and a fraction from 0 to 1; got {self}.")

    def doubt(self, command: CommandPath) -> Doubt | None:
        """Return the first reason not to trust a command, or None.

        Parameters
        ----------
        command : CommandPath
        """
        outside = 1.0 - float(np.mean(command.in_domain))
        if outside > self.outside or not command.in_domain[-1]:
            return Doubt("out of domain", outside, self.outside)
        if command.status[-1] != "OK":  # its interval is of the correction that was not made
            return Doubt("cut", 1.0, 0.0)
        # NaN marks what was not learned, and so is not known at all.
        half_widths = np.where(np.isnan(command.interval95[-1]), np.inf, command.interval95[-1])
        position, rotation = float(half_widths[:3].max()), float(half_widths[3:].max())
        if position > self.position:
            return Doubt("position interval", position, self.position)
        if rotation > self.rotation:
            return Doubt("rotation interval", rotation, self.rotation)
        return None


@dataclass(frozen=True, eq=False)
class Planned:
    """A path that was chosen.

    Parameters
    ----------
    number : int, which of the paths, from 0
    path : DesiredPath
    command : CommandPath
    doubts : tuple of Doubt
        Why the paths before it were left, and at the end why this one is doubtful too, where none was trusted.
    trusted : bool, whether its correction is within the margins
    """

    number: int
    path: DesiredPath
    command: CommandPath
    doubts: tuple[Doubt, ...]
    trusted: bool


def first_trusted(corrector: Corrects, paths: Iterable[DesiredPath], margins: Margins, mode: Mode = "full") -> Planned:
    """Return the first path that can be trusted; when none can, the last one, with `trusted` False.

    Parameters
    ----------
    corrector : Corrects
    paths : iterable of DesiredPath, several ways to do the same, best first; later ones are only corrected when needed
    margins : Margins
    mode : "full" or "endpoints", see :func:`corrected`

    Raises
    ------
    DataError
        There is no path.
    """
    doubts: tuple[Doubt, ...] = ()
    last: Planned | None = None
    for number, path in enumerate(paths):
        command = corrected(corrector, path, mode)
        doubt = margins.doubt(command)
        doubts = doubts if doubt is None else (*doubts, doubt)
        last = Planned(number, path, command, doubts, trusted=doubt is None)
        if last.trusted:
            break
    if last is None:
        raise DataError("there is no path to choose from.")
    return last
