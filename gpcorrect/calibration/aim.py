"""Commands of joints moved on by what they would miss, as a model of where commands take the joints says.

A joint stands still while its command crosses the slack, so that many commands belong to one place, and a regression
from places to commands answers with their mean. The other way round, from commands to places, the slack is a law of
what was commanded before. So that model is asked where the answers of the first would take the joints, and the commands
are moved by half of what is missing there, twice.

Each step looks at the desired path and at the commands of the step before, never at its own: there is no loop that
could run away. Velocities are those of the desired path: commands that were moved by a degree within a millisecond
would look fast, and be moved back.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from gpcorrect.calibration.dataset import clocks
from gpcorrect.calibration.joints import JointCorrector
from gpcorrect.errors import DataError
from gpcorrect.gpr import IntervalCalibration
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, frozen_array

STEPS, SHARE = 2, 0.5
"""How often commands are moved, and by how much of what is missing; chosen by hand on `dvrk_random`, where joints 5 and
6 of held-out commands are off by 5.5 and 5.1 degrees without, 5.0 and 4.6 after one step, 4.8 and 4.4 after two or
three, 4.9 and 4.5 after five. A simulated dVRK arrived within .78, .63, .61, .61 and .63 mm (bench/closed_loop.py).
All with the commands' own velocities, which shiver; .57 mm after two with those of the desired path, as now."""


@dataclass(frozen=True, eq=False)
class Aim:
    """Where commands take the joints, and how much of what they miss is added to them in each step."""

    reached: JointCorrector  # from commanded joints to those reached
    share: FloatArray  # (d,) 0 to 1; 0 for joints that are not moved
    # of the poses that commands reach: what holds for left-out ones; None in files of before there was one
    arrivals: IntervalCalibration | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "share", frozen_array(self.share))
        view = self.reached.view
        fits = self.share.shape == (len(view.types),) and view.direction == "estimate"
        fits = fits and (self.arrivals is None or len(self.arrivals.factor) == 6)
        if not (fits and ((self.share >= 0) & (self.share <= 1)).all()):
            raise DataError(
                f"a model of {len(view.types)} joints in direction {view.direction} does not move commands by"
                f" {self.share.tolist()} of what they miss."
            )

    @classmethod
    def learn(cls, reached: JointCorrector, errors: FloatArray, joints: CalibrationLog, first: FloatArray) -> Self:
        """Return what moves the joints that it says miss by more than it errs itself, or whose commands it betters.

        In its slack a command may be moved and the place is the same: commands of the log need not come nearer.

        Parameters
        ----------
        reached : JointCorrector, learned from the log
        errors : (k, d) array, of it at left-out samples, rad or m; NaN where unknown
        joints : CalibrationLog, n samples of commanded joints and those reached
        first : (n, d) array
            Commands found for these without the samples' own trajectories, rad or m; NaN where there are none.
        """
        asked, wanted = joints.setpoint_jp, joints.external_jp
        assert asked is not None
        assert wanted is not None
        aim = cls(reached, np.full(asked.shape[1], SHARE))
        moved, _ = aim.moved(wanted, first, joints.time, joints.session)
        missed, _ = aim._missed(wanted, first, joints.time, joints.session)
        known = np.isfinite(moved).all(axis=1) & np.isfinite(asked).all(axis=1)
        before, after, beside = ((part[known] ** 2).mean(axis=0) for part in (first - asked, moved - asked, missed))
        return cls(reached, np.where((after <= before) | (beside > np.nanmean(errors**2, axis=0)), SHARE, 0.0))

    def moved(
        self, q: FloatArray, first: FloatArray, time: FloatArray, sessions: IntArray
    ) -> tuple[FloatArray, BoolArray]:
        """Return commands `(n, d)` along a path, and where the model was asked beyond what it learned `(n,)`.

        Commands are NaN where desired joints or first commands are.

        Parameters
        ----------
        q : (n, d) array, desired joints, rad or m
        first : (n, d) array, what to command for them without this model
        time : (n,) array, s
        sessions : (n,) int array, homing or day
        """
        found, beyond = first, np.zeros(len(q), dtype=bool)
        for _ in range(STEPS):
            missed, outside = self._missed(q, found, time, sessions)
            found, beyond = found + self.share * missed, beyond | outside
        return found, beyond

    def _missed(
        self, q: FloatArray, commands: FloatArray, time: FloatArray, sessions: IntArray
    ) -> tuple[FloatArray, BoolArray]:
        """Return by how much commands `(n, d)` miss the joints of a path, and where the model cannot know `(n,)`."""
        reached = self.reached.correct_path(commands, time, sessions=clocks(time, sessions), along=q)
        assert reached.joints is not None
        return q - reached.joints, ~np.asarray(reached.in_domain)

    def stream(self) -> _AimStream:
        """Return what moves commands one after the other."""
        return _AimStream(self)


class _AimStream:
    """Moves commands sample after sample, as the whole path is moved."""

    def __init__(self, aim: Aim) -> None:
        self._share, self._streams = aim.share, [aim.reached.stream() for _ in range(STEPS)]

    def moved(self, time: float, q: FloatArray, first: FloatArray) -> tuple[FloatArray, bool]:
        """Return what to command `(d,)`, see :meth:`Aim.moved`; NaN with a missing number, and the path begins anew."""
        found, beyond = first, False
        for stream in self._streams:
            reached = stream.correct(time, found, along=q)
            assert reached.joints is not None
            found, beyond = found + self._share * (q - reached.joints), beyond or not reached.in_domain
        return found, beyond
