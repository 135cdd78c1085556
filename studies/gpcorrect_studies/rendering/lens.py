"""A pinhole camera with radial and tangential distortion, and where it stands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.types import FloatArray

INVERSIONS = 10  # fixed-point steps: 1e-7 px for a webcam's distortion


@dataclass(frozen=True, eq=False)
class Lens:
    """One camera of the rendered world.

    Parameters
    ----------
    position : (3,) array, optical centre, world frame, m
    axes : (3, 3) array, columns: the camera's right, down and forward directions in the world frame
    focal : (2,) tuple, pixels along u and v
    middle : (2,) tuple, principal point; the centre of the first pixel is at (0, 0)
    distortion : (5,) tuple, k1, k2, p1, p2, k3 of Brown's model
    size : (2,) tuple, width and height in pixels
    """

    position: FloatArray
    axes: FloatArray
    focal: tuple[float, float] = (600.0, 600.0)
    middle: tuple[float, float] = (319.5, 239.5)
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    size: tuple[int, int] = (640, 480)

    def pixels(self, points: FloatArray) -> FloatArray:
        """Pixels `(..., 2)` at which points of the world appear.

        Parameters
        ----------
        points : (..., 3) array, world frame, m
        """
        local = (np.asarray(points) - self.position) @ self.axes
        x, y = self._bent(local[..., 0] / local[..., 2], local[..., 1] / local[..., 2])
        return np.stack([self.focal[0] * x + self.middle[0], self.focal[1] * y + self.middle[1]], axis=-1)

    def directions(self, u: FloatArray, v: FloatArray) -> FloatArray:
        """World directions `(..., 3)`, not normalised, of the rays through pixels.

        Parameters
        ----------
        u, v : arrays of one shape, pixels to the right and down
        """
        u_flat, v_flat = (u - self.middle[0]) / self.focal[0], (v - self.middle[1]) / self.focal[1]
        x, y = u_flat, v_flat
        for _ in range(INVERSIONS):
            bent_x, bent_y = self._bent(x, y)
            x, y = x + u_flat - bent_x, y + v_flat - bent_y
        return np.stack([x, y, np.ones_like(x)], axis=-1) @ self.axes.T

    def _bent(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return (
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )


def looking_at(position: FloatArray, goal: FloatArray, roll: float = 0.0) -> FloatArray:
    """Axes `(3, 3)` of a camera whose optical axis goes through a point.

    Parameters
    ----------
    position, goal : (3,) arrays, optical centre and the point, world frame, m
    roll : float, rad about the optical axis
    """
    forward = np.asarray(goal, dtype=np.float64) - position
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right = right / np.linalg.norm(right)
    down = np.cross(forward, right)
    c, s = np.cos(roll), np.sin(roll)
    return np.stack([c * right + s * down, c * down - s * right, forward], axis=1)
