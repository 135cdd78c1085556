"""Looks for balls in one picture: near a prediction, or everywhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.types import FloatArray
from gpcorrect.vision.camera import Camera
from gpcorrect.vision.circles import Window, colour_regions, find_circles
from gpcorrect.vision.opencv import Image, cv2
from gpcorrect.vision.rim import Outline, outline
from gpcorrect.vision.target import BallSpec
from gpcorrect.vision.views import FrameRules, Reason

__all__ = ["Expected", "Found", "colour_share", "look_everywhere", "look_near"]

MARGIN = 1.3  # times the radius, around the prediction's window
SIZES = (0.006, 0.25)  # of the picture's height: least and greatest radius of a ball about which nothing is known
LEAST_RADIUS = 3.0  # px
SURE_ARC, SURE_SIZE, SURE_COLOUR = 0.8, 0.1, 0.5  # shares of rim, radius and disc that need no second opinion
COLOUR_SHARE = 0.25  # of the disc that must be of the ball's colour


@dataclass(frozen=True, eq=False)
class Expected:
    """Where a ball should appear: pixel, radius (px), and how much wider than usual to look."""

    pixel: FloatArray
    radius: float
    tolerance: float = 1.0


@dataclass(frozen=True, eq=False)
class Found:
    """What a search found: an outline, or the reason why not."""

    outline: Outline | None
    reason: Reason = ""


def look_near(image: Image, camera: Camera, ball: BallSpec, expected: Expected, rules: FrameRules) -> Found:
    """Look for a ball where it should be, of the size that it should have."""
    at_once = _at_once(image, camera, ball, expected)
    if at_once is not None:
        return Found(at_once)
    reach = rules.motion_px * expected.tolerance
    window = Window.around(expected.pixel, reach + MARGIN * expected.radius + 3.0, image)
    spread = min(rules.radius * max(expected.tolerance, 1.0), 0.6)
    radii = (max((1 - spread) * expected.radius - 1.0, 2.0), (1 + spread) * expected.radius + 1.0)
    circles = find_circles(image, ball.colour, window, radii)
    if not circles:
        return Found(None, "not found")
    found = outline(image, circles[0], camera.intrinsics)
    if found is None or colour_share(image, found, ball) < COLOUR_SHARE:
        return Found(None, "not found")
    if not radii[0] <= found.radius <= radii[1]:
        return Found(None, "wrong size")
    if float(np.linalg.norm(found.pixel - expected.pixel)) > reach:
        return Found(None, "moved too far")
    return Found(found)


def _at_once(image: Image, camera: Camera, ball: BallSpec, expected: Expected) -> Outline | None:
    """Take the outline around the predicted circle itself, when all of a rim is there: no search is needed then."""
    found = outline(image, np.array([*expected.pixel, expected.radius]), camera.intrinsics)
    if found is None or found.arc < SURE_ARC or abs(found.radius - expected.radius) > SURE_SIZE * expected.radius + 0.3:
        return None
    return found if colour_share(image, found, ball) > SURE_COLOUR else None


def look_everywhere(image: Image, camera: Camera, ball: BallSpec) -> list[Outline]:
    """Return what may be a ball anywhere in a picture, the likeliest first."""
    height = image.shape[0]
    bounds = (max(SIZES[0] * height, LEAST_RADIUS), SIZES[1] * height)
    outlines: list[Outline] = []
    for window, patch in colour_regions(image, ball.colour, bounds):
        for found in _in_region(image, camera, ball, window, patch, bounds):
            if not _known(found, outlines):
                outlines.append(found)
    return sorted(outlines, key=lambda o: o.rms_px / o.arc)


def _in_region(
    image: Image, camera: Camera, ball: BallSpec, window: Window, patch: FloatArray, bounds: tuple[float, float]
) -> list[Outline]:
    """Find what a patch of colour may hold: itself when it is a ball, else the circles in it."""
    alone = outline(image, patch, camera.intrinsics)
    if alone is not None and alone.arc > SURE_ARC and _may_be(image, alone, ball, bounds):
        return [alone]
    outlines = []
    for radii in _size_guesses(float(patch[2]), bounds):
        for circle in find_circles(image, ball.colour, window, radii):
            found = outline(image, circle, camera.intrinsics)
            if found is not None and _may_be(image, found, ball, bounds):
                outlines.append(found)
    return outlines


def _may_be(image: Image, found: Outline, ball: BallSpec, bounds: tuple[float, float]) -> bool:
    sized = bounds[0] * 0.8 <= found.radius <= bounds[1] * 1.2
    return sized and colour_share(image, found, ball) >= COLOUR_SHARE


def _size_guesses(size: float, bounds: tuple[float, float]) -> list[tuple[float, float]]:
    """Radius ranges to try for a patch of colour: its own size, and half of it when it may be merged with another."""
    own = (max(0.75 * size, bounds[0]), min(1.5 * size + 2.0, bounds[1]))
    smaller = (max(0.4 * size, bounds[0]), 0.8 * size)
    return [r for r in (own, smaller) if r[1] > r[0] + 1.0]


def _known(found: Outline, outlines: list[Outline]) -> bool:
    return any(float(np.linalg.norm(found.pixel - o.pixel)) < 0.5 * min(found.radius, o.radius) for o in outlines)


def colour_share(image: Image, found: Outline, ball: BallSpec) -> float:
    """Share of the outline's disc that is of the ball's colour; what other balls hide is not counted as missing."""
    radius = found.radius
    window = Window.around(found.pixel, radius, image)
    if window.empty:
        return 0.0
    hsv = cv2.cvtColor(window.cut(image), cv2.COLOR_BGR2HSV)
    v, u = np.mgrid[window.top : window.bottom, window.left : window.right]
    disc = (u - found.pixel[0]) ** 2 + (v - found.pixel[1]) ** 2 < (0.9 * radius) ** 2
    return float(np.count_nonzero(ball.colour.mask(hsv)[disc])) / max(int(disc.sum()), 1)
