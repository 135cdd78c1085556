"""The whole task: two arms that may not be in the middle together, what became of every fragment, and the comparison.

Mahler 2014, Sec. V-D: the same fragments with pictures, and with a correction in open loop.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpcorrect import se3
from gpcorrect.correction import Correction
from gpcorrect.planning import Corrects, Margins, Mode
from gpcorrect.types import FloatArray
from gpcorrect_studies.debridement.robot import SimulatedRobot
from gpcorrect_studies.debridement.scene import CLOSING, FINDING, OPENING, Scene, Station, catches, drops_in, grasps
from gpcorrect_studies.debridement.strategies import Approach, LookAndMove, OpenLoop, Strategy

ATTEMPTS = 3  # most grasps at one fragment before it is given up
SIGHT = 0.0005  # m; standard deviation of a fragment's place as the camera finds it, along each axis
MIDDLE = 0.015  # m to either side of the dividing plane, where one arm may be at a time; chosen by hand
PAPER = {"seconds_per_fragment": 15.8, "times_faster": 3.8}  # Mahler 2014, with correction, and against replanning


@dataclass(frozen=True, eq=False)
class Fetched:
    """What became of one fragment."""

    arm: str
    fragment: FloatArray  # (3,) where it lay, tracker frame
    removed: bool
    attempts: int
    seconds: float  # from finding it to having dropped it, or given it up
    clock: float  # task time at that end, s
    misses_mm: tuple[float, ...]  # how far the tool was from the fragment at each closing of the jaws
    looks: int  # pictures of the tool
    replanned: int  # grasps that were left because their correction was not sure enough
    careful: bool  # whether the arm went by pictures for want of a sure correction


@dataclass(frozen=True, eq=False)
class ArmRecord:
    """Where one arm's tool went."""

    name: str
    trace: FloatArray  # (n, 4) task time (s) and true tool position (m, tracker frame)
    seconds: float  # when the arm was done
    waited: float  # seconds of it in which the other arm had the middle


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one strategy achieved."""

    fetched: tuple[Fetched, ...]
    arms: tuple[ArmRecord, ...]

    @property
    def success_rate(self) -> float:
        """Fraction of fragments removed."""
        return float(np.mean([f.removed for f in self.fetched]))

    @property
    def retries(self) -> int:
        """Attempts beyond the first of each fragment."""
        return sum(f.attempts - 1 for f in self.fetched)

    @property
    def seconds_per_fragment(self) -> float:
        """Working time of one arm for one fragment, s."""
        return float(np.mean([f.seconds for f in self.fetched]))

    def to_dict(self) -> dict[str, Any]:
        """Return the figures, plain."""
        misses = np.concatenate([f.misses_mm for f in self.fetched])
        return {
            "fragments": len(self.fetched),
            "success_rate": self.success_rate,
            "first_attempt_rate": float(np.mean([f.removed and f.attempts == 1 for f in self.fetched])),
            "retries": self.retries,
            "seconds_per_fragment": self.seconds_per_fragment,
            "seconds_in_all": max(arm.seconds for arm in self.arms),
            "waited_seconds": sum(arm.waited for arm in self.arms),
            "miss_mm_mean": float(misses.mean()),
            "miss_mm_max": float(misses.max()),
            "looks": sum(f.looks for f in self.fetched),
            "replanned": sum(f.replanned for f in self.fetched),
            "careful": sum(f.careful for f in self.fetched),
        }


@dataclass(frozen=True, eq=False)
class Mission:
    """The task."""

    scene: Scene
    stations: tuple[Station, ...]  # one or two arms
    fragments: FloatArray  # (n, 3) tracker frame
    start: float = 0.0  # session time at which it begins, s

    def _in_the_middle(self, number: int) -> bool:
        """Return whether a fragment lies where both arms could meet."""
        return len(self.stations) > 1 and abs(float(self.scene.along(self.fragments[number])[0])) < MIDDLE


def debride(mission: Mission, strategies: Sequence[Strategy], rng: np.random.Generator) -> Outcome:
    """Let every arm fetch the fragments of its side.

    Parameters
    ----------
    mission : Mission
    strategies : sequence of Strategy, one an arm, in the order of the stations
    rng : numpy.random.Generator, of the camera's noise
    """
    workers = [
        _Worker(mission, station, strategy, child)
        for station, strategy, child in zip(mission.stations, strategies, rng.spawn(len(strategies)), strict=True)
    ]
    middle_free, fetched = 0.0, []
    while any(worker.left for worker in workers):
        worker = min((w for w in workers if w.left), key=lambda w: w.robot.clock)
        # A fragment in the middle comes next only when the middle is free or nothing else is left.
        free = [n for n in worker.left if worker.robot.clock >= middle_free or not mission._in_the_middle(n)]
        number = (free or worker.left)[0]
        worker.left.remove(number)
        if mission._in_the_middle(number):
            seconds = max(0.0, middle_free - worker.robot.clock)
            worker.robot.wait(seconds)
            worker.waited += seconds
        fetched.append(worker.fetch(mission.fragments[number]))
        if mission._in_the_middle(number):
            middle_free = worker.robot.clock
    arms = [ArmRecord(w.robot.station.name, w.robot.trace, w.robot.clock, w.waited) for w in workers]
    return Outcome(tuple(fetched), tuple(arms))


@dataclass(frozen=True, eq=False)
class _Try:
    """One attempt: how it went, how far off the tool was, whether the jaws caught, whether the bowl got it."""

    approach: Approach
    miss_mm: float
    caught: bool
    removed: bool


class _Worker:
    """One arm at work."""

    def __init__(self, mission: Mission, station: Station, strategy: Strategy, rng: np.random.Generator) -> None:
        self._mission, self._strategy, self._rng = mission, strategy, rng
        self.robot = SimulatedRobot(station, rng, mission.start)
        x = mission.scene.along(mission.fragments)[:, 0]
        # Numbers of the fragments on this arm's side.
        self.left = [i for i in range(len(x)) if station.side == 0.0 or (x[i] >= 0) == (station.side > 0)]
        self.waited = 0.0
        strategy.begin(self.robot)

    def fetch(self, fragment: FloatArray) -> Fetched:
        """Fetch one fragment, or give it up.

        Parameters
        ----------
        fragment : (3,) array, m, tracker frame
        """
        begin = self.robot.clock
        tries: list[_Try] = []
        while len(tries) < ATTEMPTS and not (tries and tries[-1].caught):
            tries.append(self._attempt(fragment))
        return Fetched(
            arm=self.robot.station.name,
            fragment=fragment,
            removed=tries[-1].removed,
            attempts=len(tries),
            seconds=self.robot.clock - begin,
            clock=self.robot.clock,
            misses_mm=tuple(t.miss_mm for t in tries),
            looks=sum(t.approach.looks for t in tries),
            replanned=sum(len(t.approach.doubts) for t in tries),
            careful=any(t.approach.careful for t in tries),
        )

    def _attempt(self, fragment: FloatArray) -> _Try:
        """Find the fragment, go there, close the jaws, and bring what they hold to the bowl."""
        mission, robot, up = self._mission, self.robot, self._mission.scene.up
        robot.wait(FINDING)
        seen = fragment + SIGHT * self._rng.standard_normal(3)
        approach = self._strategy.approach(robot, grasps(mission.scene, robot.station, seen))
        robot.wait(CLOSING)
        miss_mm = 1e3 * float(np.linalg.norm(robot.tool_pose[:3, 3] - fragment))
        caught = catches(robot.tool_pose, approach.grasp.T_grasp, fragment, up)
        self._strategy.carry(robot, approach, to_bowl=caught)
        if not caught:
            return _Try(approach, miss_mm, caught=False, removed=False)
        robot.wait(OPENING)
        removed = drops_in(robot.tool_pose, mission.scene.bowl(robot.station), up)
        return _Try(approach, miss_mm, caught=True, removed=removed)


@dataclass(frozen=True, eq=False)
class Condition:
    """One way to do the task, and what came of it in each set of fragments."""

    name: str
    speed: float  # m/s
    outcomes: tuple[Outcome, ...]  # one a set; pictures show the first

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
