"""Replanning in confidence: of several ways to do the same, the first one whose correction is sure enough."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from gpcorrect.errors import DataError
from gpcorrect.planning.correction import CommandPath, Corrects, Mode, corrected
from gpcorrect.planning.margins import Doubt, Margins
from gpcorrect.planning.paths import DesiredPath

__all__ = ["Planned", "first_trusted"]


@dataclass(frozen=True, eq=False)
class Planned:
    """A way that was chosen.

    Parameters
    ----------
    number : int
        Which of the ways, from 0.
    path : DesiredPath
    command : CommandPath
    doubts : tuple of Doubt
        Why the ways before it were left, and at the end why this one is doubtful too, where none was trusted.
    trusted : bool
        Whether its correction is within the margins.
    """

    number: int
    path: DesiredPath
    command: CommandPath
    doubts: tuple[Doubt, ...]
    trusted: bool


def first_trusted(corrector: Corrects, ways: Iterable[DesiredPath], margins: Margins, mode: Mode = "full") -> Planned:
    """Return the first way that can be trusted; when none can, the last one, which says so.

    Raises
    ------
    DataError
        There is no way.
    """
    doubts: list[Doubt] = []
    last: Planned | None = None
    for number, path in enumerate(ways):
        command = corrected(corrector, path, mode)
        doubt = margins.doubt(command)
        if doubt is None:
            return Planned(number, path, command, tuple(doubts), trusted=True)
        doubts.append(doubt)
        last = Planned(number, path, command, tuple(doubts), trusted=False)
    if last is None:
        raise DataError("there is no way to choose from.")
    return last
