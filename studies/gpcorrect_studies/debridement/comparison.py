"""The comparison of Mahler 2014, Sec. V-D: the same fragments with pictures, and with a correction in open loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpcorrect import se3
from gpcorrect.correction import Correction
from gpcorrect.planning import Corrects, Margins, Mode
from gpcorrect.types import FloatArray
from gpcorrect_studies.debridement.mission import Mission, Outcome, debride
from gpcorrect_studies.debridement.scene import Station
from gpcorrect_studies.debridement.strategies import LookAndMove, OpenLoop, Strategy

PAPER = {"seconds_per_fragment": 15.8, "times_faster": 3.8}  # Mahler 2014, with correction, and against replanning


@dataclass(frozen=True, eq=False)
class Condition:
    """One way to do the task, and what came of it in each set of fragments.

    Parameters
    ----------
    name : str
    speed : float, m/s
    outcomes : tuple of Outcome, one a set; pictures show the first
    """

    name: str
    speed: float
    outcomes: tuple[Outcome, ...]

    @property
    def outcome(self) -> Outcome:
        """Of the first set."""
        return self.outcomes[0]

    @classmethod
    def joined(cls, sets: Sequence[Sequence[Condition]]) -> tuple[Condition, ...]:
        """Return the ways to do the task over several sets.

        Parameters
        ----------
        sets : sequence, from :func:`compare`, one a set
        """
        return tuple(
            cls(ways[0].name, ways[0].speed, tuple(outcome for way in ways for outcome in way.outcomes))
            for ways in zip(*sets, strict=True)
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the figures, plain: means over the sets, and what is counted in all of them; and each set's own."""
        each = [outcome.to_dict() for outcome in self.outcomes]
        whole = {
            name: sum(one[name] for one in each)
            if isinstance(value, int)
            else float(np.mean([one[name] for one in each]))
            for name, value in each[0].items()
        }
        whole["miss_mm_max"] = max(one["miss_mm_max"] for one in each)
        return {"name": self.name, "speed_cm_s": 100 * self.speed, **whole, "sets": each}

    def to_words(self) -> list[str]:
        """Return name, cm/s, removed, at once, retries, replanned, looks, miss (mm), seconds a fragment and in all."""
        row = self.to_dict()
        return [
            row["name"],
            f"{row['speed_cm_s']:.0f}",
            f"{100 * row['success_rate']:.0f} %",
            f"{100 * row['first_attempt_rate']:.0f} %",
            str(row["retries"]),
            str(row["replanned"]),
            str(row["looks"]),
            f"{row['miss_mm_mean']:.1f}",
            f"{row['seconds_per_fragment']:.1f}",
            f"{row['seconds_in_all']:.0f}",
        ]


def compare(
    mission: Mission,
    correctors: Sequence[Corrects],
    seed: int,
    *,
    fast: float = 0.06,
    slow: float = 0.01,
    margins: Margins | None = None,
    mode: Mode = "full",
) -> tuple[Condition, ...]:
    """Do the task four times over the same fragments.

    Parameters
    ----------
    mission : Mission
    correctors : sequence of Corrects, one an arm, in the order of the stations
    seed : int, of the camera's noise; the same for every condition
    fast, slow : float, speeds of the open loop and with pictures, m/s
    margins, mode : as of :class:`OpenLoop`

    Returns
    -------
    tuple of Condition
        Replanning without correction; correction in open loop, without a single picture; to see what the correction
        does, the same without it; and correction with pictures where it is not sure enough.
    """
    sure, anything = margins or Margins(), Margins(np.inf, np.inf, 1.0)
    ways: list[tuple[str, float, Sequence[Strategy]]] = [
        ("no correction, replanning", slow, [LookAndMove(slow) for _ in correctors]),
        ("corrected, open loop", fast, [OpenLoop(each, fast, sure, mode) for each in correctors]),
        ("no correction, open loop", fast, [OpenLoop(_ByHand(s), fast, anything, mode) for s in mission.stations]),
        (
            "corrected, looking where unsure",
            fast,
            [OpenLoop(each, fast, sure, mode, LookAndMove(slow)) for each in correctors],
        ),
    ]
    return tuple(
        Condition(name, speed, (debride(mission, strategies, np.random.default_rng(seed)),))
        for name, speed, strategies in ways
    )


class _ByHand:
    """What a planner does that knows no correction: turns poses into the base frame as registered by hand."""

    def __init__(self, station: Station) -> None:
        self._T_base_tracker = se3.invert(station.T_tracker_base)

    def correct_path(self, poses: FloatArray, times: FloatArray) -> Correction:
        n = len(times)
        T = se3.compose(self._T_base_tracker, se3.from_parts(poses[:, :3], poses[:, 3:]))
        unknown = np.full((n, 6), np.nan)
        return Correction(*se3.to_parts(T), None, unknown, unknown, np.zeros(n, dtype=np.int64))
