"""When each camera looked: views of one frame that were not taken at one moment, and by how much, from the motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpcorrect.types import FloatArray, IntArray
from gpcorrect.vision.camera import Camera
from gpcorrect.vision.pose import Linearised
from gpcorrect.vision.settings import ClockSettings


class Clocks:
    """How long after the first camera each other one looks; learned while the tool moves (:meth:`learn`).

    The first camera's clock is the recording's: what all of them are late by together leaves no trace in pictures.
    Cameras with a delay of their own are believed; the others' are unknown.
    """

    def __init__(self, cameras: Sequence[Camera], settings: ClockSettings) -> None:
        self.settings = settings
        self._readout = np.array([camera.readout / camera.intrinsics.height for camera in cameras])  # s a row
        self.middle = 0.5 * float(np.mean([camera.readout for camera in cameras]))  # s after a frame's time
        given = np.array([camera.delay if camera.delay is not None else 0.0 for camera in cameras])
        known = np.array([camera.delay is not None or k == 0 for k, camera in enumerate(cameras)])
        self._given = known
        self._information = np.diag(np.where(known, settings.known, settings.unknown) ** -2.0)
        self._prior, self._start = self._information, given
        self._right = self._prior @ given
        self.learned_until = -np.inf  # s: frames until then are known already, and count once

    @property
    def delays(self) -> FloatArray:
        """Delay `(c,)` of each camera, s: none where it is not shown that there is one."""
        solved: FloatArray = np.linalg.solve(self._information, self._right)
        shown = np.abs(solved) > self.settings.shown * self.stds
        return np.where(shown | self._given, solved, 0.0)

    @property
    def covariance(self) -> FloatArray:
        """Covariance `(c, c)` of the delays, s^2."""
        return np.asarray(np.linalg.inv(self._information), dtype=np.float64)

    @property
    def stds(self) -> FloatArray:
        """Standard deviations `(c,)` of the delays, s."""
        return np.asarray(np.sqrt(np.diag(self.covariance)), dtype=np.float64)

    def of_views(self, cameras: IntArray, rows: FloatArray) -> FloatArray:
        """Return by how much later than the middle of the frame's readout each view was taken, s `(k,)`.

        Parameters
        ----------
        cameras : (k,) int array
        rows : (k,) array, pixel rows of the views: a rolling shutter reads them one after the other, from the top
        """
        return np.asarray(self.delays[cameras] + self._readout[cameras] * rows - self.middle)

    def spread(self, last: Linearised, cameras: IntArray) -> FloatArray:
        """Return what the uncertainty of the delays adds to the covariance of a pose: `(6, 6)`.

        Parameters
        ----------
        last : Linearised, of the pose's fit
        cameras : (k,) int array, of its views
        """
        gain = last.gain(self._effects(last, cameras))
        return np.asarray(gain @ self.covariance @ gain.T)

    def learn(self, last: Linearised, cameras: IntArray) -> None:
        """Take in what is left of the views of a moving tool: a camera that is late sees it farther along.

        Recursive least squares on the delays with the pose of this frame eliminated. Its velocity must come from the
        frames before: solved for in this frame, it would explain a wrong delay by a wrong speed.

        Parameters
        ----------
        last : Linearised, of a fit with that velocity held
        cameras : (k,) int array, of its views
        """
        speed = float(np.linalg.norm(last.twist[:3])) + self.settings.arm * float(np.linalg.norm(last.twist[3:]))
        if speed < self.settings.least_speed:
            return
        effects, delays = self._effects(last, cameras), self.delays
        weighted = np.einsum("kia,kij->kaj", effects, last.weights)
        scale = max(last.chi_squared, 1.0)
        right = last.projected(effects)
        information = np.einsum("kaj,kjb->ab", weighted, effects) - right.T @ np.linalg.solve(last.information, right)
        gradient = np.einsum("kaj,kj->a", weighted, last.residual)
        old = 1.0 - 1.0 / self.settings.memory
        self._information = self._prior + old * (self._information - self._prior) + information / scale
        before = self._prior @ self._start
        self._right = before + old * (self._right - before) + (information @ delays + gradient) / scale

    def _effects(self, last: Linearised, cameras: IntArray) -> FloatArray:
        """Return what a delay of each camera does to the views `(k, 2, c)`."""
        effects = np.zeros((len(cameras), 2, len(self._right)))
        effects[np.arange(len(cameras)), :, cameras] = last.velocity
        return effects
