"""Shaded balls in front of clutter, seen through a lens with distortion: supersampled, blurred, noisy, eight bits.

A lens blurs light, and cameras code it afterwards: grey levels are light to the power 1 / 2.2 (IEC 61966-2-1, sRGB).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from gpcorrect.types import FloatArray

INVERSIONS = 10  # fixed-point steps: 1e-7 px for a webcam's distortion
Picture = NDArray[np.uint8]
Raster = NDArray[np.floating[Any]]
GAMMA = 2.2  # of that code
NOISE_MARGIN = 64  # px by which the stored noise field is larger than a picture: each picture cuts its own piece


@dataclass(frozen=True, eq=False)
class Lens:
    """One camera of the rendered world."""

    position: FloatArray  # (3,) optical centre, world frame, m
    axes: FloatArray  # (3, 3) columns: the camera's right, down and forward directions in the world frame
    focal: tuple[float, float] = (600.0, 600.0)  # pixels along u and v
    middle: tuple[float, float] = (319.5, 239.5)  # principal point; the centre of the first pixel is at (0, 0)
    # k1, k2, p1, p2, k3 of Brown's model
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    size: tuple[int, int] = (640, 480)  # width and height in pixels

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


@dataclass(frozen=True, eq=False)
class Ball:
    """A ball: centre (m, world frame), radius (m), colour (red, green, blue; 0 to 255), gloss (0 to 1).

    A rolling shutter sees it elsewhere in every pixel row: `drift` (m a row) away from `centre`, where it is in `row`.
    """

    centre: FloatArray
    radius: float
    colour: tuple[float, float, float]
    gloss: float = 0.3
    drift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    row: float = 0.0


@dataclass(frozen=True, eq=False)
class Card:
    """Something flat held before the lens: left, top, right, bottom in pixels, and its colour."""

    box: tuple[int, int, int, int]
    colour: tuple[float, float, float] = (45.0, 45.0, 50.0)


@dataclass(frozen=True)
class Light:
    """Where the light comes from, the fraction of it that is everywhere, and the exponent of highlights."""

    towards: tuple[float, float, float] = (0.25, -0.35, 0.9)
    ambient: float = 0.45
    shine: float = 25.0


@dataclass(eq=False)
class Studio:
    """One camera and what stands still before it."""

    lens: Lens
    background: Raster  # (height, width, 3) what is behind the balls, red green blue, 0 to 255
    light: Light = field(default_factory=Light)  # of the balls
    blur: float = 0.7  # standard deviation of the lens' blur, px
    noise: float = 2.0  # standard deviation of the sensor's noise, grey levels
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))  # of the noise
    samples: int = 3  # rays along each side of a pixel

    def __post_init__(self) -> None:
        self.background = np.asarray(self.background, dtype=np.float32)
        self._lit = _light(self.background)
        self._blurred = _blurred(self._lit, self.blur)
        width, height = self.lens.size
        shape = (height + NOISE_MARGIN, width + NOISE_MARGIN, 3)
        self._field = self.rng.standard_normal(shape, dtype=np.float32) * self.noise

    def photograph(self, balls: Sequence[Ball] = (), cards: Sequence[Card] = ()) -> Picture:
        """Return the picture `(height, width, 3)`, blue green red as video files hold it.

        Parameters
        ----------
        balls : sequence of Ball
        cards : sequence of Card, that hide parts of it
        """
        sharp, blurred = np.array(self._lit), np.array(self._blurred)
        boxes = [box for box in (self._box(ball) for ball in balls) if box is not None]
        far_first = sorted(balls, key=lambda ball: -float(np.linalg.norm(ball.centre - self.lens.position)))
        for ball in far_first:
            self._paint(sharp, ball)
        for card in cards:
            left, top, right, bottom = card.box
            sharp[top:bottom, left:right] = _light(np.asarray(card.colour))
            boxes.append((left, top, right, bottom))
        for box in boxes:
            _refresh(blurred, sharp, box, self.blur)
        down, right = self.rng.integers(NOISE_MARGIN, size=2)
        height, width = blurred.shape[:2]
        noisy = blurred + self._field[down : down + height, right : right + width]
        noisy += np.float32(0.5)
        np.clip(noisy, 0, 255, out=noisy)
        return np.ascontiguousarray(noisy.astype(np.uint8)[..., ::-1])

    def _box(self, ball: Ball) -> tuple[int, int, int, int] | None:
        """Pixels that a ball can touch, or None when it is behind the camera or outside the picture."""
        local = (ball.centre - self.lens.position) @ self.lens.axes
        if local[2] < 2 * ball.radius:
            return None
        u, v = self.lens.pixels(ball.centre)
        reach = 1.5 * max(self.lens.focal) * ball.radius / local[2] + 3.0
        width, height = self.lens.size
        left, right = max(int(u - reach), 0), min(int(u + reach) + 2, width)
        top, bottom = max(int(v - reach), 0), min(int(v + reach) + 2, height)
        return (left, top, right, bottom) if left < right and top < bottom else None

    def _paint(self, image: Raster, ball: Ball) -> None:
        box = self._box(ball)
        if box is None:
            return
        left, top, right, bottom = box
        v, u = (row.ravel() for row in np.mgrid[top:bottom, left:right])
        _, to_centre, along = _rays(ball, self.lens, u, v)
        beside2 = np.einsum("...i,...i", to_centre, to_centre) - along**2
        # Pixels that the ball may touch: their middle's ray passes it within its radius and two pixels.
        near = beside2 < (ball.radius + 2.0 * along / min(self.lens.focal)) ** 2
        u, v = u[near], v[near]
        offsets = (np.arange(self.samples) + 0.5) / self.samples - 0.5
        down, across = (row.ravel() for row in np.meshgrid(offsets, offsets, indexing="ij"))
        colour, hit = _seen(ball, self.lens, self.light, u[:, None] + across, v[:, None] + down)
        image[v, u] = image[v, u] * (1.0 - hit.mean(axis=1))[:, None] + colour.mean(axis=1)


def _rays(ball: Ball, lens: Lens, u: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return unit directions of rays, the vectors from lens to ball as each row sees it, and these along the rays."""
    d = lens.directions(u, v)
    d = d / np.sqrt(np.einsum("...i,...i", d, d))[..., None]
    to_centre = ball.centre - lens.position + (v - ball.row)[..., None] * np.array(ball.drift)
    return d, to_centre, np.einsum("...i,...i", d, to_centre)


def _seen(ball: Ball, lens: Lens, light: Light, u: FloatArray, v: FloatArray) -> tuple[FloatArray, NDArray[Any]]:
    """Light `(..., 3)` of a ball along rays, none beside it, and which rays meet it."""
    d, to_centre, along = _rays(ball, lens, u, v)
    depth2 = ball.radius**2 - (np.einsum("...i,...i", to_centre, to_centre) - along**2)
    hit = depth2 > 0.0
    d, to_centre = d[hit], to_centre[hit]
    distance = along[hit] - np.sqrt(depth2[hit])
    normal = (distance[:, None] * d - to_centre) / ball.radius
    toward = np.asarray(light.towards) / np.linalg.norm(light.towards)
    facing = normal @ toward
    mirrored = 2.0 * facing[:, None] * normal - toward
    sparkle = ball.gloss * np.maximum(-np.einsum("ni,ni->n", mirrored, d), 0.0) ** light.shine * (facing > 0)
    diffuse = light.ambient + (1.0 - light.ambient) * np.maximum(facing, 0.0)
    colours = np.zeros((*hit.shape, 3))
    colours[hit] = diffuse[:, None] * _light(np.asarray(ball.colour)) + sparkle[:, None]
    return colours, hit


def _light(levels: Raster) -> Raster:
    """Light that grey levels stand for, 0 to 1."""
    return np.asarray((levels / 255.0) ** GAMMA)


def _blurred(light: Raster, sigma: float) -> Raster:
    """Grey levels of light that a lens has blurred."""
    seen = gaussian_filter(light, (sigma, sigma, 0.0), mode="nearest") if sigma > 0 else light
    return np.asarray(255.0 * np.clip(seen, 0.0, 1.0) ** (1.0 / GAMMA))


def _refresh(blurred: Raster, sharp: Raster, box: tuple[int, int, int, int], sigma: float) -> None:
    """Blur again what changed, with a margin from which the blur reaches in."""
    reach = int(np.ceil(4 * sigma)) + 1
    left, top, right, bottom = box
    l2, t2 = max(left - 2 * reach, 0), max(top - 2 * reach, 0)
    part = _blurred(sharp[t2 : bottom + 2 * reach, l2 : right + 2 * reach], sigma)
    l1, t1 = max(left - reach, 0), max(top - reach, 0)
    rows, columns = slice(t1, bottom + reach), slice(l1, right + reach)
    height, width = blurred[rows, columns].shape[:2]
    blurred[rows, columns] = part[t1 - t2 : t1 - t2 + height, l1 - l2 : l1 - l2 + width]


def backdrop(
    size: tuple[int, int], rng: np.random.Generator, *, pieces: int = 25, colourful: float = 0.3
) -> FloatArray:
    """Return clutter `(height, width, 3)`: uneven ground with boxes and discs on it, some of them colourful.

    Parameters
    ----------
    size : (2,) tuple, width and height
    rng : Generator, of everything
    pieces : int, things that lie about
    colourful : float, 0: all grey; 1: colours as strong as the balls'
    """
    width, height = size
    ground = gaussian_filter(rng.standard_normal((height, width)), 30.0)
    fine = gaussian_filter(rng.standard_normal((height, width)), 2.0)
    level = 110.0 + 25.0 * ground / ground.std() + 4.0 * fine / fine.std()
    image = level[..., None] * np.array([1.0, 0.98, 0.95])
    for _ in range(pieces):
        a, b = rng.uniform(5, 60, 2)
        turn = rng.uniform(0, np.pi)
        x, y = rng.uniform(0, width), rng.uniform(0, height)
        left, top, reach = max(int(x - a - b), 0), max(int(y - a - b), 0), int(2 * (a + b)) + 2
        part = image[top : top + reach, left : left + reach]
        rows, columns = np.mgrid[: part.shape[0], : part.shape[1]]
        du, dv = columns + (left - x), rows + (top - y)
        p, q = du * np.cos(turn) + dv * np.sin(turn), dv * np.cos(turn) - du * np.sin(turn)
        inside = (np.abs(p) < a) & (np.abs(q) < b) if rng.random() < 0.6 else (p / a) ** 2 + (q / b) ** 2 < 1
        grey = rng.uniform(20, 230)
        part[inside] = (1 - colourful) * grey + colourful * rng.uniform(0, 255, 3)
    return np.asarray(np.clip(image, 0, 255))
