"""How fast a path may be streamed to a robot, by its own clock and by where it has come."""

from __future__ import annotations

import math

import numpy as np

from gpcorrect.types import FloatArray

LONGEST_STEP = 0.08  # chosen by hand: s of a path between two commands
LONGEST_LEAD = 0.2  # chosen by hand: s of a path from where the robot is to a command; our arm refuses 0.3
GRAIN = 0.005  # chosen by hand: s of a path between two places at which the robot is looked for
ALIKE = 0.01  # chosen by hand: s at the path's top speed; places nearer to each other than that are one
RESTED = 0.5  # chosen by hand: s of the robot's clock after the last command: who is where it says has obeyed it
TINY = 1e-9  # s at the path's top speed: rounding
FLOOR = 1e-6  # rad/s or m/s: the top speed of a joint that rests


class Pacing:
    """Moments of a path as the robot's clock goes, none too far ahead of the robot.

    A tool that its machine held up goes on where it was: the path takes longer, and nothing jumps. States that waited
    meanwhile come all at once after it, and so may the commands for them at the robot: none is further along the path
    than `LONGEST_LEAD` from where the latest setpoint shows that the robot has come. Where the path has been at that
    setpoint more than once since, as at a corner, that is the first time.

    Parameters
    ----------
    times : (n,) array, s
    clock : float, the robot's, as it begins, s
    q : (n, k) array, optional, joints of the path, rad or m; without them the robot's clock alone sets the pace
    """

    def __init__(self, times: FloatArray, clock: float, q: FloatArray | None = None) -> None:
        self.moment = self._seen = float(times[0])
        self._end, self._clock, self._sent, self._times, self._q = float(times[-1]), clock, clock, times, q
        if q is not None:
            self._fastest = np.abs(np.diff(q, axis=0) / np.diff(times)[:, None]).max(axis=0, initial=FLOOR)

    @property
    def is_over(self) -> bool:
        """Whether the moment is the path's last."""
        return self.moment >= self._end

    @property
    def joints(self) -> FloatArray:
        """(k,) joints at the moment."""
        joints: FloatArray = self._joints_at(np.array([self.moment]))[0]
        return joints

    def advance(self, clock: float, setpoint: FloatArray) -> None:
        """Go on to the moment for the next command; it stays while the robot has yet to come nearer.

        Parameters
        ----------
        clock : float, stamp of the robot's latest state, s
        setpoint : (k,) array, that state's joints
        """
        passed, self._clock = clock - self._clock, clock
        there = self.moment if self._q is None else self._come_to(setpoint)
        further = min(self.moment + min(passed, LONGEST_STEP), there + LONGEST_LEAD, self._end)
        if further > self.moment:
            self.moment, self._sent = further, clock

    def _come_to(self, setpoint: FloatArray) -> float:
        """Return the end of the first stretch of the path, from where the robot was seen on, that lies about it."""
        moments = np.linspace(self._seen, self.moment, 1 + math.ceil((self.moment - self._seen) / GRAIN))
        apart = (np.abs(self._joints_at(moments) - setpoint) / self._fastest).sum(axis=1)
        if apart[-1] <= ALIKE and self._clock > self._sent + RESTED:
            self._seen = self.moment
            return self.moment
        near = apart <= apart.min() + ALIKE
        first = int(near.argmax())
        stretch = apart[first : first + int(np.append(~near[first:], True).argmax())]
        # The last of the nearest, so that a long rest of the path is not gone over again and again.
        self._seen = float(moments[first + np.flatnonzero(stretch <= stretch.min() + TINY)[-1]])
        return float(moments[first + len(stretch) - 1])

    def _joints_at(self, moments: FloatArray) -> FloatArray:
        assert self._q is not None
        return np.stack([np.interp(moments, self._times, column) for column in self._q.T], axis=1)
