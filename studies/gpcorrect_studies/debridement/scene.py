"""Where the work is done: fragments in a box between two arms, a bowl on each side, one camera frame for all.

Mahler 2014, Sec. V: fragments lie anywhere in 8 x 8 x 2 cm. The box's first axis points from the middle to the first
arm's side, its third one up. What is not in the paper (bowls, tolerances, times) is ours and stands here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gpcorrect import se3
from gpcorrect.arms import Arm, arm_named
from gpcorrect.errors import DataError
from gpcorrect.sim import Machine, machine_of, preset
from gpcorrect.sim.reaching import upright, working_posture
from gpcorrect.types import FloatArray, frozen_array

__all__ = ["SIZE", "Scene", "Station", "stations"]

SIZE = np.array([0.08, 0.08, 0.02])  # m
BOWL = np.array([0.045, -0.03, 0.0])  # m from the box's centre, on the arm's own side
PRESET = "raven2_debridement"
SIDES = ("raven2_left", "raven2_right")
# How far each arm's base is from where it was registered by hand: 1 cm and 4 degrees, each another way.
MISREGISTERED = (None, (np.array([-0.004, 0.007, -0.005]), np.array([-0.03, 0.05, 0.02])))


@dataclass(frozen=True, eq=False)
class Station:
    """One arm at its place.

    Parameters
    ----------
    name : str
        CRTK name.
    machine : Machine
        As it really is; its base in the tracker's frame included.
    T_tracker_base : (4, 4) array
        Its base as registered by hand: what a planner without correction goes by.
    R_tool : (3, 3) array
        The tool's middle orientation, tracker frame.
    side : float
        +1 or -1: the arm's side along the box's first axis; 0 for an arm that works alone.
    """

    name: str
    machine: Machine
    T_tracker_base: FloatArray
    R_tool: FloatArray
    side: float

    @property
    def arm(self) -> Arm:
        """Nominal kinematics."""
        return arm_named(self.machine.arm)


@dataclass(frozen=True, eq=False)
class Scene:
    """The box, in the tracker's frame.

    Parameters
    ----------
    T_tracker_box : (4, 4) array
        Centre and axes.
    size : (3,) array
        m.
    """

    T_tracker_box: FloatArray
    size: FloatArray

    def fragments(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Positions `(count, 3)` drawn evenly in the box, tracker frame."""
        return self.at((rng.random((count, 3)) - 0.5) * self.size)

    def at(self, box: FloatArray) -> FloatArray:
        """Tracker positions `(..., 3)` of positions given along the box's axes."""
        position: FloatArray = box @ self.T_tracker_box[:3, :3].T + self.T_tracker_box[:3, 3]
        return position

    def along(self, position: FloatArray) -> FloatArray:
        """Positions `(..., 3)` along the box's axes of tracker positions."""
        box: FloatArray = (position - self.T_tracker_box[:3, 3]) @ self.T_tracker_box[:3, :3]
        return box

    def bowl(self, station: Station) -> FloatArray:
        """(3,) centre of the station's bowl, at the height of its rim, tracker frame."""
        return self.at(BOWL * np.array([station.side or 1.0, 1.0, 1.0]))

    @property
    def up(self) -> FloatArray:
        """(3,) direction away from the floor, tracker frame."""
        upwards: FloatArray = self.T_tracker_box[:3, 2]
        return upwards


def stations(arms: int = 2) -> tuple[Scene, tuple[Station, ...]]:
    """Set up the scene with one or two arms; with two, their shafts lean towards each other from either side.

    Raises
    ------
    DataError
        There are one or two.
    """
    if arms not in (1, 2):
        raise DataError(f"the task has one or two arms, got {arms}.")
    T_first = _box(arm_named(SIDES[0]), 0.0)
    scene = Scene(frozen_array(T_first), frozen_array(SIZE))
    return scene, tuple(_station(k, T_first, alone=arms == 1) for k in range(arms))


def _station(number: int, T_tracker_box: FloatArray, *, alone: bool) -> Station:
    name = SIDES[number]
    arm = arm_named(name)
    nominal = se3.compose(T_tracker_box, se3.invert(_box(arm, np.pi * number)))
    machine = machine_of(preset(PRESET).model_copy(update={"arm": name}))
    error = machine.T_tracker_base
    wrong = MISREGISTERED[number]
    if wrong is not None:
        error = se3.pose(se3.matrix_from_rotvec(wrong[1]), wrong[0])
    R_tool = nominal[:3, :3] @ arm.forward(working_posture(arm))[:3, :3]
    machine = replace(machine, T_tracker_base=frozen_array(se3.compose(error, nominal)))
    side = 0.0 if alone else 1.0 - 2.0 * number
    return Station(f"arm{number + 1}", machine, frozen_array(nominal), frozen_array(R_tool), side)


def _box(arm: Arm, yaw: float) -> FloatArray:
    """Box around the tool of an arm at work, base frame; its first axis points to the remote centre, turned by yaw."""
    T = arm.forward(working_posture(arm))
    axes = upright(arm.gravity)
    towards = axes.T @ -T[:3, 3]
    angle = np.arctan2(towards[1], towards[0]) + yaw
    turn = se3.matrix_from_rotvec(np.array([0.0, 0.0, angle]))
    return se3.pose(axes @ turn, T[:3, 3])
