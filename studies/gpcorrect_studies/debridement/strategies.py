"""Two ways to bring a tool to a fragment: slowly with many pictures, or at once with a correction.

`LookAndMove` is static look-and-move visual servoing; `OpenLoop` takes no picture where the correction is sure enough.
Both `begin` with a robot at home, `approach` a fragment by one of several grasps, the best first, and `carry` it to the
bowl, or stay over its place after a failed grasp; each ends at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gpcorrect import se3
from gpcorrect.planning import Corrects, DesiredPath, Doubt, Margins, Mode, corrected, first_trusted, reach
from gpcorrect.sim.reaching import Pace
from gpcorrect.types import FloatArray
from gpcorrect_studies.debridement.robot import SimulatedRobot
from gpcorrect_studies.debridement.scene import LOOKING, SETTLING, Grasp

ACCELERATION = 0.5  # m/s^2, as in the simulated recordings
TURN_RATE = 1.5  # rad/s, as in the simulated recordings
LEG = 0.025  # m, longest way between two pictures; chosen by hand, like the next two
GOOD_ENOUGH = 0.002  # m, a miss where it matters
MOST_LOOKS = 6  # pictures at one place before the arm stops improving


@dataclass(frozen=True)
class Approach:
    """How a fragment was approached."""

    grasp: Grasp  # the one that was chosen
    looks: int = 0  # pictures of the tool that were taken
    doubts: tuple[Doubt, ...] = ()  # why others were not chosen
    careful: bool = False  # whether no correction was sure enough, so that the arm went by pictures


@dataclass
class LookAndMove:
    """No correction: go a little, stop, take a picture, and subtract the miss from what is commanded next."""

    speed: float = 0.01  # m/s
    _shift: FloatArray = field(default_factory=lambda: np.zeros(3), init=False)
    _turn: FloatArray = field(default_factory=lambda: np.eye(3), init=False)
    _at: FloatArray = field(default_factory=lambda: np.eye(4), init=False)
    _looks: int = field(default=0, init=False)

    def begin(self, robot: SimulatedRobot) -> None:
        """Take a picture where the arm stands."""
        self._shift, self._turn = np.zeros(3), np.eye(3)
        self._at = se3.compose(robot.station.T_tracker_base, robot.command_pose)
        self._look(robot)

    def approach(self, robot: SimulatedRobot, ways: Sequence[Grasp]) -> Approach:
        """Take the first grasp, leg by leg, and correct the last miss until it is small."""
        self._looks, grasp = 0, ways[0]
        self._go(robot, grasp.T_above)
        self._go(robot, grasp.T_grasp)
        for _ in range(MOST_LOOKS):
            if float(np.linalg.norm(self._miss)) <= GOOD_ENOUGH:
                break
            self._step(robot, grasp.T_grasp)
        return Approach(grasp, self._looks)

    def carry(self, robot: SimulatedRobot, approach: Approach, *, to_bowl: bool) -> None:
        """Lift and carry, leg by leg."""
        self._go(robot, approach.grasp.T_above)
        if to_bowl:
            self._go(robot, approach.grasp.T_bowl)

    def _go(self, robot: SimulatedRobot, goal: FloatArray) -> None:
        legs = max(1, int(np.ceil(np.linalg.norm(goal[:3, 3] - self._at[:3, 3]) / LEG)))
        way = se3.log(se3.compose(goal, se3.invert(self._at)))
        begin = self._at
        for leg in range(1, legs + 1):
            self._step(robot, se3.compose(se3.exp(way * leg / legs), begin))

    def _step(self, robot: SimulatedRobot, goal: FloatArray) -> None:
        moved = se3.pose(self._turn @ goal[:3, :3], goal[:3, 3] + self._shift)
        command = se3.compose(se3.invert(robot.station.T_tracker_base), moved)
        path = reach(np.stack([robot.command_pose, command]), Pace(self.speed, ACCELERATION, TURN_RATE))
        robot.follow(path.times, path.T)
        self._at = goal
        self._look(robot)

    def _look(self, robot: SimulatedRobot) -> None:
        """Take a picture, and learn by how much the tool misses where it should be."""
        robot.wait(SETTLING + LOOKING)
        seen, goal = robot.look(), self._at
        self._looks += 1
        self._miss = goal[:3, 3] - seen[:3, 3]
        self._shift = self._shift + self._miss
        self._turn = goal[:3, :3] @ seen[:3, :3].T @ self._turn


@dataclass
class OpenLoop:
    """With correction: plan all the way to the fragment, ask what to command, and go without a picture."""

    corrector: Corrects  # of this arm
    speed: float = 0.06  # m/s
    # how sure the correction must be at the fragment; otherwise another tilt is planned
    margins: Margins = field(default_factory=Margins)
    mode: Mode = "full"
    # what to do where no grasp is sure enough; without it the last one is taken all the same
    careful: LookAndMove | None = None
    _at: FloatArray = field(default_factory=lambda: np.eye(4), init=False)

    def begin(self, robot: SimulatedRobot) -> None:
        """Start at the pose at home as registered by hand; the first path ends elsewhere anyway."""
        self._at = se3.compose(robot.station.T_tracker_base, robot.command_pose)

    def approach(self, robot: SimulatedRobot, ways: Sequence[Grasp]) -> Approach:
        """Take the first grasp whose correction is sure enough."""
        paths = (self._path(way.T_above, way.T_grasp) for way in ways)
        chosen = first_trusted(self.corrector, paths, self.margins, self.mode)
        if not chosen.trusted and self.careful is not None:
            self.careful.begin(robot)
            there = self.careful.approach(robot, ways)
            self._at = there.grasp.T_grasp
            return Approach(there.grasp, there.looks, chosen.doubts, careful=True)
        self._follow(robot, chosen.path, chosen.command.T)
        return Approach(ways[chosen.number], 0, chosen.doubts)

    def carry(self, robot: SimulatedRobot, approach: Approach, *, to_bowl: bool) -> None:
        """Lift and carry; the bowl is wide, so no margin is asked for."""
        grasp = approach.grasp
        path = self._path(grasp.T_above, grasp.T_bowl) if to_bowl else self._path(grasp.T_above)
        self._follow(robot, path, corrected(self.corrector, path, self.mode).T)

    def _path(self, *stops: FloatArray) -> DesiredPath:
        return reach(np.stack([self._at, *stops]), Pace(self.speed, ACCELERATION, TURN_RATE))

    def _follow(self, robot: SimulatedRobot, path: DesiredPath, command: FloatArray) -> None:
        robot.follow(path.times, command)
        robot.wait(SETTLING)
        self._at = path.goal


Strategy = LookAndMove | OpenLoop
