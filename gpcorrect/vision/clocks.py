"""When each camera looked: views of one frame that were not taken at one moment, and by how much, from the motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.types import FloatArray, IntArray
from gpcorrect.vision.camera import Camera
from gpcorrect.vision.pose import POSE, Linearised, Observations, normal_equations, reprojection
from gpcorrect.vision.settings import ClockSettings

PICTURE = 4  # numbers by which a camera's picture may be off: two of a shift, its scale, its turn
LOOSE = 1e-4  # m^2 and rad^2, variance of a frame's pose before its views: the turn about two balls' line stays finite


@dataclass(frozen=True, eq=False)
class Moment:
    """What a frame saw of a tool whose pose was believed."""

    time: float  # s, of the pose
    T_tracker_tool: FloatArray  # (4, 4) m
    observations: Observations
    delays: FloatArray  # (c,) of the cameras as the views were taken for, s


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
        self._places = np.stack([camera.T_camera_tracker for camera in cameras])
        self._focal = np.array([camera.intrinsics.focal for camera in cameras])
        self._half = np.array([0.5 * camera.intrinsics.width for camera in cameras])
        delays = np.where(known, settings.known, settings.unknown)
        self._start = np.concatenate([given, np.zeros(PICTURE * len(known))])
        self._prior = np.diag(np.concatenate([delays, np.full(PICTURE * len(known), settings.widest_px)]) ** -2.0)
        self._information, self._right = np.zeros_like(self._prior), np.zeros_like(self._start)  # of what was seen
        self._settle()
        self.learned_until = -np.inf  # s: frames until then are known already, and count once

    @property
    def delays(self) -> FloatArray:
        """Delay `(c,)` of each camera, s: none where it is not shown that there is one."""
        solved = self._solved[: len(self._given)]
        return np.where(self._given | (np.abs(solved) > self.settings.shown * self.stds), solved, 0.0)

    @property
    def stds(self) -> FloatArray:
        """Standard deviations `(c,)` of the delays, s."""
        return np.asarray(np.sqrt(np.diag(self.covariance)), dtype=np.float64)

    def _settle(self) -> None:
        """Solve for the delays and what is wrong with each picture, which is as likely as what seems to be there.

        Where a shift explains nothing it leaves no doubt of the delays either; where it may explain as much, it does.
        """
        right, prior, cameras = self._right + self._prior @ self._start, np.diag(self._prior).copy(), len(self._given)
        seeming = np.linalg.solve(self._information + self._prior, right)[cameras:]
        prior[cameras:] = 1.0 / (self.settings.off_px**2 + seeming**2)
        covariance = np.asarray(np.linalg.inv(self._information + np.diag(prior)), dtype=np.float64)
        self._solved: FloatArray = covariance @ right
        self.covariance: FloatArray = covariance[:cameras, :cameras]  # of the delays, s^2

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

    def learn(self, past: Sequence[Moment], places: FloatArray) -> None:
        """Take in what is left of the views of a moving tool: a camera that is late sees it farther along.

        Recursive least squares with the frame's pose eliminated. How the tool moved on is interpolated between the
        frames before and after: a velocity from those before lags, and leaves delays short of the true ones. Beside
        its delay each camera's picture may be shifted, turned and scaled: what that explains as well is no delay.

        Parameters
        ----------
        past : sequence of Moment, an odd number of frames in the order of time; it is learned from the middle one
        places : (b, 3) array, balls in the tool frame, m
        """
        moment, seen = past[len(past) // 2], past[len(past) // 2].observations
        if moment.time <= self.learned_until or seen.delays is None:
            return
        times = np.array([one.time for one in past])
        poses = np.stack([one.T_tracker_tool for one in past])
        nodes = np.einsum("mij,kj->mki", poses[:, :3, :3], places[seen.ball]) + poses[:, None, :3, 3]

        def at(when: FloatArray) -> FloatArray:
            i, views = np.clip(np.searchsorted(times, when), 1, len(times) - 1), np.arange(len(when))
            part = (when - times[i - 1]) / (times[i] - times[i - 1])
            return np.asarray(nodes[i - 1, views] + part[:, None] * (nodes[i, views] - nodes[i - 1, views]))

        when, apart = moment.time + seen.delays, float(np.median(np.diff(times)))
        velocity = (at(when + apart) - at(when - apart)) / (2.0 * apart)
        if float(np.sqrt(np.mean((velocity**2).sum(axis=1)))) < self.settings.least_speed:
            return
        residual, to_point = reprojection(self._places[seen.camera], at(when), seen.rays)
        arms, free = nodes[len(past) // 2] - moment.T_tracker_tool[:3, 3], POSE if len(places) > 1 else 3
        J = np.concatenate([to_point, np.cross(arms[:, None, :], to_point)], axis=2)[:, :, :free]
        weights = np.asarray(np.linalg.inv(seen.covariances), dtype=np.float64)
        effects = self._changes(seen, np.einsum("kij,kj->ki", to_point, velocity))
        information, right = normal_equations(residual, np.concatenate([J, effects], axis=2), weights)
        own = np.linalg.inv(information[:free, :free] + np.eye(free) / LOOSE)
        gain = information[free:, :free] @ own
        gradient = right[free:] - gain @ right[:free]
        left = float(np.einsum("ki,kij,kj->", residual, weights, residual) - right[:free] @ own @ right[:free])
        information = information[free:, free:] - gain @ information[:free, free:]
        start = np.concatenate([moment.delays, np.zeros(len(gradient) - len(moment.delays))])
        known = self._solved - start  # what is explained already is no noise
        left += float(known @ information @ known - 2.0 * known @ gradient)
        scale, old = max(left / (residual.size - free), 1.0), 1.0 - 1.0 / self.settings.memory
        self._information = old * self._information + information / scale
        self._right = old * self._right + (information @ start + gradient) / scale
        self._settle()

    def _changes(self, seen: Observations, velocity: FloatArray) -> FloatArray:
        """Return what a delay of each camera (s), and shifts, scale and turn of its picture (px), do to the views."""
        unit, x, y = np.ones(len(velocity)), *seen.rays.T
        focal, half = self._focal[seen.camera], self._half[seen.camera]
        own = [
            velocity.T,
            (unit / focal, 0.0 * unit),
            (0.0 * unit, unit / focal),
            (x / half, y / half),
            (-y / half, x / half),
        ]
        effects = np.zeros((len(unit), 2, len(own), len(self._focal)))
        effects[np.arange(len(unit)), :, :, seen.camera] = np.transpose(np.array(own), (2, 1, 0))
        return effects.reshape(len(unit), 2, -1)

    def _effects(self, last: Linearised, cameras: IntArray) -> FloatArray:
        """Return what a delay of each camera does to the views `(k, 2, c)`."""
        effects = np.zeros((len(cameras), 2, len(self._given)))
        effects[np.arange(len(cameras)), :, cameras] = last.velocity
        return effects
