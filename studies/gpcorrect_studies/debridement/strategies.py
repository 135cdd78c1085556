"""Two ways to be where one wants to be: look often and go slowly, or know how the arm misses and go at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from gpcorrect import se3
from gpcorrect.planning.correction import Corrects, Mode, corrected
from gpcorrect.planning.margins import Doubt, Margins
from gpcorrect.planning.paths import DesiredPath, reach
from gpcorrect.planning.replanning import first_trusted
from gpcorrect.sim.reaching import Pace
from gpcorrect.types import FloatArray
from gpcorrect_studies.debridement.robot import SimulatedRobot
from gpcorrect_studies.debridement.skills import Errand, Times

__all__ = ["Approach", "LookAndMove", "OpenLoop", "Strategy"]

ACCELERATION = 0.5  # m/s^2
TURN_RATE = 1.5  # rad/s


@dataclass(frozen=True)
class Approach:
    """How a fragment was gone to.

    Parameters
    ----------
    errand : Errand
        The way that was chosen.
    looks : int
        Pictures of the tool that were taken.
    doubts : tuple of Doubt
        Why other ways were not chosen.
    careful : bool
        Whether no correction was sure enough, so that the arm looked its way there.
    """

    errand: Errand
    looks: int = 0
    doubts: tuple[Doubt, ...] = ()
    careful: bool = False


class Strategy(Protocol):
    """Moves one robot through an errand."""

    def begin(self, robot: SimulatedRobot) -> None:
        """Take over a robot at home."""

    def approach(self, robot: SimulatedRobot, ways: Sequence[Errand]) -> Approach:
        """Bring the tool to the fragment, at rest."""

    def bring(self, robot: SimulatedRobot, approach: Approach) -> None:
        """Lift and carry to the bowl, at rest."""

    def retreat(self, robot: SimulatedRobot, approach: Approach) -> None:
        """Go back over the fragment after a failed grasp."""


@dataclass
class LookAndMove:
    """No correction: go a little, stop, look, and take the miss off what is commanded next.

    Parameters
    ----------
    speed : float
        m/s.
    leg : float
        Longest way between two looks, m.
    tolerance : float
        Miss that is good enough where it matters, m.
    most_looks : int
        Looks at one place before it is left at that.
    times : Times
    """

    speed: float = 0.01
    leg: float = 0.025
    tolerance: float = 0.002
    most_looks: int = 6
    times: Times = field(default_factory=Times)
    _shift: FloatArray = field(default_factory=lambda: np.zeros(3), init=False)
    _turn: FloatArray = field(default_factory=lambda: np.eye(3), init=False)
    _at: FloatArray = field(default_factory=lambda: np.eye(4), init=False)
    _looks: int = field(default=0, init=False)

    def begin(self, robot: SimulatedRobot) -> None:
        """Look once, where the arm stands."""
        self._shift, self._turn = np.zeros(3), np.eye(3)
        self._at = se3.compose(robot.station.T_tracker_base, robot.command_pose)
        self._look(robot, self._at)

    def approach(self, robot: SimulatedRobot, ways: Sequence[Errand]) -> Approach:
        """Take the first way, look by look, and correct the last miss until it is small."""
        self._looks, errand = 0, ways[0]
        self._go(robot, errand.T_above)
        self._go(robot, errand.T_grasp)
        for _ in range(self.most_looks):
            if float(np.linalg.norm(self._miss)) <= self.tolerance:
                break
            self._step(robot, errand.T_grasp)
        return Approach(errand, self._looks)

    def bring(self, robot: SimulatedRobot, approach: Approach) -> None:
        """Lift and carry, look by look."""
        self._go(robot, approach.errand.T_above)
        self._go(robot, approach.errand.T_bowl)

    def retreat(self, robot: SimulatedRobot, approach: Approach) -> None:
        """Go back up."""
        self._go(robot, approach.errand.T_above)

    def _go(self, robot: SimulatedRobot, goal: FloatArray) -> None:
        legs = max(1, int(np.ceil(np.linalg.norm(goal[:3, 3] - self._at[:3, 3]) / self.leg)))
        way = se3.log(se3.compose(goal, se3.invert(self._at)))
        begin = self._at
        for leg in range(1, legs + 1):
            self._step(robot, se3.compose(se3.exp(way * leg / legs), begin))

    def _step(self, robot: SimulatedRobot, goal: FloatArray) -> None:
        start, stop = robot.command_pose, self._commanded(robot, goal)
        path = reach(np.stack([start, stop]), Pace(self.speed, ACCELERATION, TURN_RATE))
        robot.follow(path.times, path.T)
        self._at = goal
        self._look(robot, goal)

    def _commanded(self, robot: SimulatedRobot, goal: FloatArray) -> FloatArray:
        moved = se3.pose(self._turn @ goal[:3, :3], goal[:3, 3] + self._shift)
        return se3.compose(se3.invert(robot.station.T_tracker_base), moved)

    def _look(self, robot: SimulatedRobot, goal: FloatArray) -> None:
        robot.wait(self.times.settle + self.times.look)
        seen = robot.look()
        self._looks += 1
        self._miss = goal[:3, 3] - seen[:3, 3]
        self._shift = self._shift + self._miss
        self._turn = goal[:3, :3] @ seen[:3, :3].T @ self._turn


@dataclass
class OpenLoop:
    """With correction: plan all the way to the fragment, ask what to command, and go without looking.

    Parameters
    ----------
    corrector : Corrects
        Of this arm.
    speed : float
        m/s.
    margins : Margins
        How sure the correction must be at the fragment; a way that is not is replanned with another tilt.
    mode : "full" or "endpoints"
    times : Times
    careful : LookAndMove or None
        What to do where no way is sure enough; without it the last way is taken all the same.
    """

    corrector: Corrects
    speed: float = 0.06
    margins: Margins = field(default_factory=Margins)
    mode: Mode = "full"
    times: Times = field(default_factory=Times)
    careful: LookAndMove | None = None
    _at: FloatArray = field(default_factory=lambda: np.eye(4), init=False)

    def begin(self, robot: SimulatedRobot) -> None:
        """Take the pose at home as registered by hand; the first path ends elsewhere anyway."""
        self._at = se3.compose(robot.station.T_tracker_base, robot.command_pose)

    def approach(self, robot: SimulatedRobot, ways: Sequence[Errand]) -> Approach:
        """Go the first way that is sure enough."""
        chosen = first_trusted(self.corrector, (self._to(way) for way in ways), self.margins, self.mode)
        if not chosen.trusted and self.careful is not None:
            self.careful.begin(robot)
            there = self.careful.approach(robot, ways)
            self._at = there.errand.T_grasp
            return Approach(there.errand, there.looks, chosen.doubts, careful=True)
        robot.follow(chosen.command.times, chosen.command.T)
        robot.wait(self.times.settle)
        self._at = chosen.path.goal
        return Approach(ways[chosen.number], 0, chosen.doubts)

    def bring(self, robot: SimulatedRobot, approach: Approach) -> None:
        """Lift and carry; the bowl is wide, so no margin is asked for."""
        self._go(robot, approach.errand.T_above, approach.errand.T_bowl)

    def retreat(self, robot: SimulatedRobot, approach: Approach) -> None:
        """Go back up."""
        self._go(robot, approach.errand.T_above)

    def _to(self, errand: Errand) -> DesiredPath:
        return self._path(errand.T_above, errand.T_grasp)

    def _go(self, robot: SimulatedRobot, *stops: FloatArray) -> None:
        path = self._path(*stops)
        command = corrected(self.corrector, path, self.mode)
        robot.follow(command.times, command.T)
        robot.wait(self.times.settle)
        self._at = path.goal

    def _path(self, *stops: FloatArray) -> DesiredPath:
        return reach(np.stack([self._at, *stops]), Pace(self.speed, ACCELERATION, TURN_RATE))
