"""What one fragment asks for: where the tool goes, how long hands and eyes take, and what counts as done."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect import se3
from gpcorrect.types import FloatArray
from gpcorrect_studies.debridement.scene import Scene, Station

__all__ = ["Errand", "Gripper", "Times", "errands"]

CLEARANCE = 0.02  # m above a fragment, and above the bowl
TILTS = np.deg2rad([0.0, 12.0, -12.0, 20.0, -20.0])  # of the tool about each horizontal axis in turn, best first


@dataclass(frozen=True)
class Times:
    """Seconds that the hands and the eyes take; they are the same for every strategy, and ours.

    Parameters
    ----------
    find : float
        To find a fragment in the camera's picture.
    settle : float
        For the arm to come to rest.
    look : float
        To take and read a picture of the tool.
    grasp, release : float
        To close and to open the jaws.
    """

    find: float = 0.5
    settle: float = 0.3
    look: float = 0.7
    grasp: float = 0.5
    release: float = 0.3


@dataclass(frozen=True)
class Gripper:
    """When a fragment is caught, and when it falls into the bowl.

    Parameters
    ----------
    sideways, height : float
        Largest distance between the jaws' middle and the fragment's, along the floor and up, m.
    turn : float
        Largest turn away from the planned orientation, rad.
    bowl : float
        Radius of the bowl, m.
    """

    sideways: float = 0.005
    height: float = 0.004
    turn: float = np.deg2rad(25.0)
    bowl: float = 0.015

    def catches(self, T_tool: FloatArray, T_grasp: FloatArray, fragment: FloatArray, up: FloatArray) -> bool:
        """Tell whether a tool really at `T_tool`, meant to be at `T_grasp`, holds a fragment when it closes."""
        miss = T_tool[:3, 3] - fragment
        height = float(miss @ up)
        sideways = float(np.linalg.norm(miss - height * up))
        turn = float(se3.angle(T_tool[:3, :3] @ T_grasp[:3, :3].T))
        return sideways <= self.sideways and abs(height) <= self.height and turn <= self.turn

    def drops_in(self, T_tool: FloatArray, bowl: FloatArray, up: FloatArray) -> bool:
        """Tell whether a fragment let go of here falls into the bowl."""
        miss = T_tool[:3, 3] - bowl
        return float(np.linalg.norm(miss - (miss @ up) * up)) <= self.bowl


@dataclass(frozen=True, eq=False)
class Errand:
    """One way to fetch one fragment: tool poses in the tracker's frame.

    Parameters
    ----------
    T_above, T_grasp, T_bowl : (4, 4) arrays
        Over the fragment, at it, and over the bowl.
    """

    T_above: FloatArray
    T_grasp: FloatArray
    T_bowl: FloatArray


def errands(scene: Scene, station: Station, fragment: FloatArray) -> tuple[Errand, ...]:
    """Return the ways to fetch a fragment, the most upright grasp first, then tilted ones."""
    bowl = scene.bowl(station) + CLEARANCE * scene.up
    ways = []
    for tilt in TILTS:
        for axis in (0, 1) if tilt else (0,):
            turn = se3.matrix_from_rotvec(tilt * scene.T_tracker_box[:3, axis])
            R = turn @ station.R_tool
            above, grasp = fragment + CLEARANCE * scene.up, fragment
            ways.append(Errand(*(se3.pose(R, place) for place in (above, grasp, bowl))))
    return tuple(ways)
