"""The robot as the task uses it: follow tool poses, wait, be seen. Here it is simulated, in its own time."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.planning import reach
from gpcorrect.sim.live import LiveArm
from gpcorrect.sim.reaching import CONTINUOUS, Pace, working_posture
from gpcorrect.sim.sensors import Sensors
from gpcorrect.types import FloatArray
from gpcorrect_studies.debridement.scene import Station

BLOCK = 20  # servo steps between two samples of the tool's true pose: paths are recorded at 50 Hz
STILL = 4  # blocks that are one, where no joint moves further in them than in one block at 6 cm/s
MOVED = {"R": 12e-3, "P": 1.2e-3}  # rad and m: that far
JOINING = Pace(speed=0.03, turn_rate=0.5)  # to where a path begins, a millimetre away as a rule; chosen by hand


class SimulatedRobot:
    """One arm of the task, with a clock of its own.

    Parameters
    ----------
    station : Station
    rng : numpy.random.Generator, of the tracker's noise
    start : float, session time at which the task begins, s: the arm has drifted since its recording
    """

    def __init__(self, station: Station, rng: np.random.Generator, start: float = 0.0) -> None:
        self.station = station
        self._arm = station.arm
        self._q = working_posture(self._arm)
        self._live = LiveArm(station.machine, self._q, start=start, block=STILL * BLOCK)
        self._little = np.array([MOVED[kind] for kind in self._arm.joint_types])
        self._sensors = Sensors(station.machine, rng)
        self._start = start
        self._seen: list[FloatArray] = []

    @property
    def clock(self) -> float:
        """Seconds since the task began."""
        return self._live.moment.time - self._start

    @property
    def command_pose(self) -> FloatArray:
        """(4, 4) tool pose that was commanded last, base frame."""
        return self._arm.forward(self._q)

    @property
    def tool_pose(self) -> FloatArray:
        """(4, 4) where the tool really is, tracker frame: for the task's outcome, not for its planner."""
        T = self._live.moment.T_base_tip
        assert T is not None
        return se3.compose(self.station.machine.T_tracker_base, T, self.station.machine.T_tip_marker)

    @property
    def trace(self) -> FloatArray:
        """(n, 4) task time and true tool position, tracker frame, at 50 Hz, or less where it hardly moves."""
        return np.array(self._seen).reshape(-1, 4)

    def follow(self, times: FloatArray, T: FloatArray) -> None:
        """Go to where tool poses begin, and follow them; DataError for one that the joint limits do not let it reach.

        Parameters
        ----------
        times : (n,) array, seconds
        T : (n, 4, 4) array, base frame
        """
        joining = reach(np.stack([self.command_pose, T[0]]), JOINING)
        for at, poses in ((joining.times, joining.T), (times, T)):
            q = self._joints(poses)
            steps = max(1, round((at[-1] - at[0]) / self._live.step))
            moments = at[0] + np.arange(1, steps + 1) * self._live.step
            self._drive(CubicSpline(at, q)(np.minimum(moments, at[-1])))
            self._q = q[-1]

    def wait(self, seconds: float) -> None:
        """Stay where the arm was commanded to.

        Parameters
        ----------
        seconds : float
        """
        self._drive(np.repeat(self._q[None], round(seconds / self._live.step), axis=0))

    def look(self) -> FloatArray:
        """Return the tool's pose as the tracker sees it, (4, 4), tracker frame."""
        here = self._live.moment
        assert here.tip is not None
        return np.asarray(self._sensors.track(here.motion.time, here.tip)[0, 0])

    def _drive(self, desired: FloatArray) -> None:
        while len(desired):
            still = (np.ptp(desired[: STILL * BLOCK], axis=0) <= self._little).all()
            block = STILL * BLOCK if still else BLOCK
            self._live.advance(desired[:block])
            self._seen.append(np.array([self.clock, *self.tool_pose[:3, 3]]))
            desired = desired[block:]

    def _joints(self, T: FloatArray) -> FloatArray:
        """Joint path of tool poses on the branch that the arm is on."""
        found = self._arm.solutions(T)
        steps = np.abs(np.diff(found.q, axis=0)).max(axis=(0, 2), initial=0.0)
        begins = np.abs(found.q[0] - self._q).max(axis=-1)
        usable = np.flatnonzero(found.within_limits.all(axis=0) & (steps < CONTINUOUS) & (begins < CONTINUOUS))
        if not len(usable):
            hint = "Choose fragments nearer to the middle of the workspace."
            raise DataError(f"{self.station.name} cannot follow this path within its joint limits.", hint=hint)
        return np.asarray(found.q[:, usable[np.argmin(begins[usable])]])
