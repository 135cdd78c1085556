"""Desired paths that no arm can follow: lone jumps are bridged, and marked.

A tracker's occlusion, or a planner's slip, shows in a path as impossible speeds into and out of a short stretch. Asked
to correct such a pose as it stands, a model would move the robot to where nothing ever was. The same limits that
cleaning learned for recordings hold here.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np

from gpcorrect import se3
from gpcorrect.cleaning import FittedCleaner
from gpcorrect.cleaning.steps import best_chain
from gpcorrect.types import BoolArray, FloatArray, IntArray, PoseSignal

POSSIBLE_FRACTION = 0.7  # least part of a run that must be possible motion, or it is left as it is; chosen by hand


@dataclass(frozen=True)
class MotionLimits:
    """Limits of motion that no working arm exceeds from one sample to another.

    Parameters
    ----------
    speeds : tuple of float, largest speed, m/s, and where orientations are observed rad/s
    noise : tuple of float, step that noise alone can make, m and rad
    longest : float, longest stretch that is bridged, s; what lasts longer may be meant
    """

    speeds: tuple[float, ...]
    noise: tuple[float, ...]
    longest: float

    @classmethod
    def of(cls, cleaner: FittedCleaner) -> Self:
        """Limits that cleaning learned from the training recording.

        Parameters
        ----------
        cleaner : FittedCleaner, cleaning of the training recording
        """
        steps = cleaner.thresholds.steps
        return cls(tuple(steps.speeds.tolist()), tuple(steps.noise.tolist()), cleaner.settings.occlusion_time)

    def bridge(
        self, signal: PoseSignal, reference: PoseSignal, time: FloatArray, labels: IntArray
    ) -> tuple[PoseSignal, BoolArray]:
        """Return the path with its lone jumps replaced by straight motion, and the mask (n,) of replaced samples.

        Parameters
        ----------
        signal : PoseSignal, n desired poses
        reference : PoseSignal, the same in the robot's frame, where the limits were learned
        time : (n,) array, s
        labels : (n,) int array, unbroken run of each sample, -1 for none
        """
        bridged = np.zeros(len(signal), dtype=bool)
        for label in np.unique(labels[labels >= 0]):
            rows = np.flatnonzero(labels == label)
            bridged[rows] = self._jumps(reference[rows], time[rows])
        if not bridged.any():
            return signal, bridged
        return _straightened(signal, time, labels, bridged), bridged

    def _jumps(self, path: PoseSignal, time: FloatArray) -> BoolArray:
        """Find the samples (n,) of one run that lie off its longest possible motion, between samples that lie on it."""
        cuts = np.flatnonzero(self._too_far(path, time, np.arange(len(time) - 1), np.arange(1, len(time))))
        off, on = np.zeros((2, len(time)), dtype=bool)
        if not len(cuts):
            return off
        first, last = np.concatenate([[0], cuts + 1]), np.concatenate([cuts, [len(time) - 1]])
        chain = best_chain(last - first + 1, first, last, lambda i, j: ~self._too_far(path, time, i, j))
        for k in chain:
            on[first[k] : last[k] + 1] = True
        if on.mean() < POSSIBLE_FRACTION:
            return off
        for a, b in pairwise(chain):
            off[last[a] + 1 : first[b]] = time[first[b]] - time[last[a]] <= self.longest
        return off

    def _too_far(self, path: PoseSignal, time: FloatArray, i: IntArray, j: IntArray) -> BoolArray:
        """Mask (m,) of the steps from samples i to later samples j that are faster than any arm."""
        dt = time[j] - time[i]
        steps = [np.linalg.norm(path.position[j] - path.position[i], axis=1)]
        if path.quaternion is not None and len(self.speeds) > 1:
            steps.append(se3.quaternion_angle(path.quaternion[i], path.quaternion[j]))
        limits = zip(steps, self.speeds, self.noise, strict=False)
        far: BoolArray = np.any([step - noise > speed * dt for step, speed, noise in limits], axis=0)
        return far


def _straightened(signal: PoseSignal, time: FloatArray, labels: IntArray, bridged: BoolArray) -> PoseSignal:
    position = signal.position.copy()
    quaternion = None if signal.quaternion is None else signal.quaternion.copy()
    for label in np.unique(labels[bridged]):
        good, bad = (np.flatnonzero((labels == label) & mask) for mask in (~bridged, bridged))
        for axis in range(3):
            position[bad, axis] = np.interp(time[bad], time[good], position[good, axis])
        if quaternion is not None:
            turned = se3.interpolate_rotations(time[good], se3.matrix_from_quaternion(quaternion[good]), time[bad])
            quaternion[bad] = se3.quaternion_from_matrix(turned)
    return PoseSignal(position, quaternion)
