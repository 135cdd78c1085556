"""Where the debridement is done and what counts as done: a box of fragments between two arms, a bowl on each side.

Mahler 2014, Sec. V: fragments lie anywhere in 8 x 8 x 2 cm. The box's first axis points from the middle to the first
arm's side, its third one up. What is not in the paper (bowls, tolerances, times) was chosen by hand and stands here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gpcorrect import se3
from gpcorrect.arms import RemoteCentreArm, arm_named
from gpcorrect.sim import Machine, machine_of, preset
from gpcorrect.sim.reaches import DEBRIDEMENT_PRESET
from gpcorrect.sim.reaching import upright, working_posture
from gpcorrect.types import FloatArray, frozen_array

SIZE = np.array([0.08, 0.08, 0.02])  # m, Mahler 2014, Sec. V
BOWL = np.array([0.045, -0.03, 0.0])  # m from the box's centre, on the arm's own side
SIDES = ("raven2_left", "raven2_right")
CLEARANCE = 0.02  # m above a fragment, and above the bowl; chosen by hand
TILTS = np.deg2rad([0.0, 12.0, -12.0, 20.0, -20.0])  # of the tool about each horizontal axis in turn, best first
# How far each arm's base is from where it was registered by hand: 1 cm and 4 degrees, each another way.
MISREGISTERED = (None, (np.array([-0.004, 0.007, -0.005]), np.array([-0.03, 0.05, 0.02])))

# Seconds that the camera and the jaws take, the same for every strategy; chosen by hand.
FINDING = 0.5  # to find a fragment in the camera's picture
SETTLING = 0.3  # for the arm to come to rest
LOOKING = 0.7  # to take and evaluate a picture of the tool
CLOSING, OPENING = 0.5, 0.3
# How far the jaws' middle may be from a fragment's, along the floor and up, m, and turned away from the plan, rad; and
# how wide the bowl is. Chosen by hand.
SIDEWAYS, HEIGHT, TURN = 0.005, 0.004, np.deg2rad(25.0)
BOWL_RADIUS = 0.015  # m


def catches(T_tool: FloatArray, T_grasp: FloatArray, fragment: FloatArray, up: FloatArray) -> bool:
    """Return whether a tool holds a fragment when its jaws close.

    Parameters
    ----------
    T_tool : (4, 4) array, true tool pose
    T_grasp : (4, 4) array, planned one, same frame
    fragment, up : (3,) arrays, its place (m), and the direction away from the floor, same frame
    """
    miss = T_tool[:3, 3] - fragment
    height = float(miss @ up)
    sideways = float(np.linalg.norm(miss - height * up))
    turn = float(se3.angle(T_tool[:3, :3] @ T_grasp[:3, :3].T))
    return sideways <= SIDEWAYS and abs(height) <= HEIGHT and turn <= float(TURN)


def drops_in(T_tool: FloatArray, bowl: FloatArray, up: FloatArray) -> bool:
    """Return whether a fragment falls into the bowl when the jaws open.

    Parameters
    ----------
    T_tool : (4, 4) array, true tool pose
    bowl, up : (3,) arrays, the bowl's centre (m), and the direction away from the floor, same frame
    """
    miss = T_tool[:3, 3] - bowl
    return float(np.linalg.norm(miss - (miss @ up) * up)) <= BOWL_RADIUS


@dataclass(frozen=True, eq=False)
class Station:
    """One arm at its place."""

    name: str  # CRTK name
    machine: Machine  # as it really is; its base in the tracker's frame included
    T_tracker_base: FloatArray  # (4, 4) its base as registered by hand: what a planner without correction goes by
    R_tool: FloatArray  # (3, 3) the tool's middle orientation, tracker frame
    side: float  # +1 or -1: the arm's side along the box's first axis; 0 for an arm that works alone

    @property
    def arm(self) -> RemoteCentreArm:
        """Nominal kinematics."""
        return arm_named(self.machine.arm)


@dataclass(frozen=True, eq=False)
class Scene:
    """The box, in the tracker's frame."""

    T_tracker_box: FloatArray  # (4, 4) centre and axes
    size: FloatArray  # (3,) m

    def fragments(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Draw positions `(count, 3)` evenly in the box, tracker frame.

        Parameters
        ----------
        count : int
        rng : numpy.random.Generator
        """
        return self.at((rng.random((count, 3)) - 0.5) * self.size)

    def at(self, box: FloatArray) -> FloatArray:
        """Return tracker positions of positions along the box's axes.

        Parameters
        ----------
        box : (..., 3) array, m
        """
        return np.asarray(box @ self.T_tracker_box[:3, :3].T + self.T_tracker_box[:3, 3])

    def along(self, position: FloatArray) -> FloatArray:
        """Return positions along the box's axes of tracker positions.

        Parameters
        ----------
        position : (..., 3) array, m
        """
        return np.asarray((position - self.T_tracker_box[:3, 3]) @ self.T_tracker_box[:3, :3])

    def bowl(self, station: Station) -> FloatArray:
        """Return the centre `(3,)` of the station's bowl, at the height of its rim, tracker frame.

        Parameters
        ----------
        station : Station
        """
        return self.at(BOWL * np.array([station.side or 1.0, 1.0, 1.0]))

    @property
    def up(self) -> FloatArray:
        """(3,) direction away from the floor, tracker frame."""
        return np.asarray(self.T_tracker_box[:3, 2])


@dataclass(frozen=True, eq=False)
class Grasp:
    """One way to fetch one fragment: tool poses in the tracker's frame."""

    # (4, 4) over the fragment, at it, and over the bowl
    T_above: FloatArray
    T_grasp: FloatArray
    T_bowl: FloatArray


def grasps(scene: Scene, station: Station, fragment: FloatArray) -> tuple[Grasp, ...]:
    """Return the ways to fetch a fragment, the most upright grasp first, then tilted ones.

    Parameters
    ----------
    scene : Scene
    station : Station
    fragment : (3,) array, m, tracker frame
    """
    bowl = scene.bowl(station) + CLEARANCE * scene.up
    ways = []
    for tilt in TILTS:
        for axis in (0, 1) if tilt else (0,):
            R = se3.matrix_from_rotvec(tilt * scene.T_tracker_box[:3, axis]) @ station.R_tool
            above = fragment + CLEARANCE * scene.up
            ways.append(Grasp(*(se3.pose(R, place) for place in (above, fragment, bowl))))
    return tuple(ways)


def stations(arms: int = 2) -> tuple[Scene, tuple[Station, ...]]:
    """Set up the scene with one or two arms; with two, their shafts lean towards each other from either side.

    Parameters
    ----------
    arms : int, 1 or 2
    """
    T_first = _box(arm_named(SIDES[0]), 0.0)
    scene = Scene(frozen_array(T_first), frozen_array(SIZE))
    return scene, tuple(_station(k, T_first, alone=arms == 1) for k in range(arms))


def _station(number: int, T_tracker_box: FloatArray, *, alone: bool) -> Station:
    name = SIDES[number]
    arm = arm_named(name)
    nominal = se3.compose(T_tracker_box, se3.invert(_box(arm, np.pi * number)))
    machine = machine_of(preset(DEBRIDEMENT_PRESET).model_copy(update={"arm": name}))
    wrong = MISREGISTERED[number]
    error = machine.T_tracker_base if wrong is None else se3.pose(se3.matrix_from_rotvec(wrong[1]), wrong[0])
    R_tool = nominal[:3, :3] @ arm.forward(working_posture(arm))[:3, :3]
    machine = replace(machine, T_tracker_base=frozen_array(se3.compose(error, nominal)))
    side = 0.0 if alone else 1.0 - 2.0 * number
    return Station(f"arm{number + 1}", machine, frozen_array(nominal), frozen_array(R_tool), side)


def _box(arm: RemoteCentreArm, yaw: float) -> FloatArray:
    """Box around the tool of an arm at work, base frame; its first axis points to the remote centre, turned by yaw."""
    T = arm.forward(working_posture(arm))
    axes = upright(arm.gravity)
    towards = axes.T @ -T[:3, 3]
    angle = np.arctan2(towards[1], towards[0]) + yaw
    return se3.pose(axes @ se3.matrix_from_rotvec(np.array([0.0, 0.0, angle])), T[:3, 3])
