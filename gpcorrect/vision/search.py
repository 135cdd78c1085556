"""Finds balls in one picture: near a prediction, or everywhere.

Circles are found as in Peng et al. 2020: Canny edges inside the enlarged colour mask, then Hough with the threshold at
which one circle is found and a second just not; where the count jumps over one, the picture is blurred a little more.
"""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from gpcorrect.types import FloatArray
from gpcorrect.vision.camera import Camera
from gpcorrect.vision.opencv import Image, cv2
from gpcorrect.vision.rim import Outline, outline
from gpcorrect.vision.settings import DEFAULT, VisionSettings
from gpcorrect.vision.target import BallSpec, Colour

RING = (0.6, 0.75, 0.9)  # of the radius: where the colour inside a circle's rim is read
LEAST_WINDOW = 6  # px: a ball of the least radius does not fit into less


class Reason(StrEnum):
    """Why a camera is not trusted with a ball; empty when it is."""

    NONE = ""
    NOT_FOUND = "not found"
    MOVED_TOO_FAR = "moved too far"
    WRONG_SIZE = "wrong size"
    AGAINST_OTHERS = "against the other cameras"
    COMING_BACK = "coming back"


REASONS = tuple(Reason)  # the codes of `Track.views` are indices into it


class Window(NamedTuple):
    """Part of a picture: left, top, right, bottom in pixels; empty when it holds too little for a ball."""

    left: int
    top: int
    right: int
    bottom: int

    @classmethod
    def around(cls, centre: FloatArray, reach: float, image: Image) -> Window:
        """Return a square window, cut off at the picture's border.

        Parameters
        ----------
        centre : (2,) array, px
        reach : float, from the centre to the sides, px
        image : (height, width, ...) array
        """
        size = np.array([image.shape[1], image.shape[0]])
        left, top = (int(v) for v in np.clip(centre - reach, 0, size))
        right, bottom = (int(v) for v in np.clip(centre + reach + 1, 0, size))
        return cls(left, top, right, bottom)

    def cut(self, image: Image) -> Image:
        """Return the part of the picture.

        Parameters
        ----------
        image : (height, width, ...) array
        """
        return image[self.top : self.bottom, self.left : self.right]

    @property
    def empty(self) -> bool:
        """Whether no ball fits into it."""
        return min(self.right - self.left, self.bottom - self.top) < LEAST_WINDOW


class Found(NamedTuple):
    """What a search found: an outline, or the reason why not."""

    outline: Outline | None
    reason: Reason = Reason.NONE


def detect_near(
    image: Image, camera: Camera, ball: BallSpec, expected: FloatArray, tolerance: float, settings: VisionSettings
) -> Found:
    """Find a ball where it should be, of the size that it should have.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
    camera : Camera
    ball : BallSpec
    expected : (3,) array, where it should be: u, v, radius, px
    tolerance : float, factor on how far from there to search
    settings : VisionSettings
    """
    balls, views = settings.balls, settings.views
    centre, radius = expected[:2], float(expected[2])
    found = outline(image, expected, camera.intrinsics, balls)
    if found is not None and found.arc >= balls.sure_arc:  # a whole rim around the prediction needs no search
        alike = abs(found.radius - radius) <= balls.sure_size * radius + 0.3
        if alike and _colour_fraction(image, found, ball) > balls.sure_colour:
            return Found(found)
    reach = views.motion_px * tolerance
    window = Window.around(centre, reach + balls.margin * radius + 3.0, image)
    spread = min(views.radius * max(tolerance, 1.0), 0.6)
    radii = (max((1 - spread) * radius - 1.0, 2.0), (1 + spread) * radius + 1.0)
    circle = find_circle(image, ball.colour, window, radii, settings)
    found = None if circle is None else outline(image, circle, camera.intrinsics, balls)
    if found is None or _colour_fraction(image, found, ball) < balls.disc_colour:
        return Found(None, Reason.NOT_FOUND)
    if not radii[0] <= found.radius <= radii[1]:
        return Found(None, Reason.WRONG_SIZE)
    if float(np.linalg.norm(found.pixel - centre)) > reach:
        return Found(None, Reason.MOVED_TOO_FAR)
    return Found(found)


def detect_everywhere(
    image: Image, camera: Camera, ball: BallSpec, settings: VisionSettings = DEFAULT
) -> list[Outline]:
    """Return what may be a ball anywhere in a picture, the likeliest first.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
    camera : Camera
    ball : BallSpec
    settings : VisionSettings
    """
    height = image.shape[0]
    least, most = settings.balls.sizes
    bounds = (max(least * height, settings.balls.least_search_px), most * height)
    outlines: list[Outline] = []
    for i, (window, patch) in enumerate(_colour_regions(image, ball.colour, bounds, settings)):
        whole = i >= settings.balls.regions
        for found in _in_region(image, camera, ball, window, patch, bounds, settings, whole_only=whole):
            apart = [float(np.linalg.norm(found.pixel - o.pixel)) / min(found.radius, o.radius) for o in outlines]
            if min(apart, default=np.inf) >= 0.5:
                outlines.append(found)
    return sorted(outlines, key=lambda o: o.rms_px / o.arc)


def _in_region(
    image: Image,
    camera: Camera,
    ball: BallSpec,
    window: Window,
    patch: FloatArray,
    bounds: tuple[float, float],
    settings: VisionSettings,
    *,
    whole_only: bool = False,
) -> list[Outline]:
    """Find what a patch of colour may hold: itself when it is a ball, else the circles in it."""
    balls = settings.balls

    def ball_at(circle: FloatArray) -> Outline | None:
        found = outline(image, circle, camera.intrinsics, balls)
        if found is None or not bounds[0] * 0.8 <= found.radius <= bounds[1] * 1.2:
            return None
        return found if _colour_fraction(image, found, ball) >= balls.disc_colour else None

    alone = ball_at(patch)
    if alone is not None and alone.arc > balls.sure_arc:
        return [alone]
    if whole_only:
        return []
    size = float(patch[2])  # its own size, and half of it when it may be merged with another
    own = (max(0.75 * size, bounds[0]), min(1.5 * size + 2.0, bounds[1]))
    smaller = (max(0.4 * size, bounds[0]), 0.8 * size)
    guesses = [radii for radii in (own, smaller) if radii[1] > radii[0] + 1.0]
    circles = [find_circle(image, ball.colour, window, radii, settings) for radii in guesses]
    return [found for c in circles if c is not None and (found := ball_at(c)) is not None]


def _colour_fraction(image: Image, found: Outline, ball: BallSpec) -> float:
    """Fraction of the outline's disc that is of the ball's colour."""
    window = Window.around(found.pixel, found.radius, image)
    if window.empty:
        return 0.0
    hsv = cv2.cvtColor(window.cut(image), cv2.COLOR_BGR2HSV)
    v, u = np.ogrid[window.top : window.bottom, window.left : window.right]
    disc = (u - found.pixel[0]) ** 2 + (v - found.pixel[1]) ** 2 < (0.9 * found.radius) ** 2
    return float(np.count_nonzero(ball.colour.mask(hsv)[disc])) / max(int(disc.sum()), 1)


def find_circle(
    image: Image, colour: Colour, window: Window, radii: tuple[float, float], settings: VisionSettings = DEFAULT
) -> FloatArray | None:
    """Find a circle (u, v, radius; px) of a colour in a window of a picture.

    Parameters
    ----------
    image : (height, width, 3) uint8 array, blue green red
    colour : Colour
    window : Window
    radii : (2,) tuple, least and greatest radius, px
    settings : VisionSettings
    """
    if window.empty:
        return None
    part = window.cut(image)
    middle = float(np.sqrt(radii[0] * min(radii[1], 4 * radii[0])))
    scale = float(np.clip(settings.balls.working_radius_px / middle, 0.25, 4.0))
    if abs(scale - 1.0) > 0.25:
        how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
        part = cv2.resize(part, None, fx=scale, fy=scale, interpolation=how)
    else:
        scale = 1.0
    mask = colour.mask(cv2.cvtColor(part, cv2.COLOR_BGR2HSV))
    if not cv2.countNonZero(mask):
        return None
    low, high = max(scale * radii[0], 2.0), max(scale * radii[1], scale * radii[0] + 2.0)
    found = _bisected_circles(part, mask, (low, high), settings)
    if not found or _ring_colour(mask, found[0]) < settings.balls.rim_colour:
        return None
    corner = np.array([window.left, window.top])
    return np.array([*((found[0][:2] + 0.5) / scale - 0.5 + corner), found[0][2] / scale])


def _bisected_circles(
    part: Image, mask: Image, radii: tuple[float, float], settings: VisionSettings
) -> list[FloatArray]:
    """Circles with the accumulator threshold at which one is found and a second just not; the strongest first."""
    # The border of the mask is what remains of a rim where ball and background are equally bright.
    border = cv2.morphologyEx(mask, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))
    enlarged = cv2.dilate(mask, np.ones((7, 7), np.uint8))
    grey = cv2.cvtColor(part, cv2.COLOR_BGR2GRAY)
    found: list[FloatArray] = []
    for blur in settings.balls.blurs_px:
        edges = cv2.bitwise_or(cv2.Canny(cv2.GaussianBlur(grey, (0, 0), blur), *settings.balls.canny), border)
        picture = cv2.GaussianBlur(cv2.bitwise_and(edges, enlarged), (0, 0), blur)
        found = _at_threshold(picture, radii, settings)
        if len(found) <= 1:
            break  # else the number jumps from none to several
    return found


def _at_threshold(picture: Image, radii: tuple[float, float], settings: VisionSettings) -> list[FloatArray]:
    """Bisect: the highest threshold that still leaves a circle; more than one where the number jumps."""
    low, high = settings.balls.accumulator
    found = _hough(picture, radii, low)
    if len(found) <= 1:
        return found
    while high - low > settings.balls.accumulator_step:
        middle = 0.5 * (low + high)
        now = _hough(picture, radii, middle)
        if len(now) == 1:
            return now
        if len(now) > 1:
            low, found = middle, now
        else:
            high = middle
    return found


def _hough(picture: Image, radii: tuple[float, float], threshold: float) -> list[FloatArray]:
    low, high = radii
    found = cv2.HoughCircles(
        picture,
        cv2.HOUGH_GRADIENT,
        1.0,
        max(low, 3.0),
        param1=60.0,
        param2=threshold,
        minRadius=int(np.floor(low)),
        maxRadius=int(np.ceil(high)),
    )
    return [] if found is None else list(np.asarray(found, dtype=np.float64).reshape(-1, found.shape[-1])[:, :3])


def _ring_colour(mask: Image, circle: FloatArray) -> float:
    """Fraction of the ring just inside a circle that is of the colour; outside the picture nothing is."""
    height, width = mask.shape
    angles = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    radii = circle[2] * np.array(RING)[:, None]
    u = np.rint(circle[0] + radii * np.cos(angles)).astype(int)
    v = np.rint(circle[1] + radii * np.sin(angles)).astype(int)
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    return float(np.count_nonzero(mask[v[inside], u[inside]]) / inside.size)


def _colour_regions(
    image: Image, colour: Colour, radii: tuple[float, float], settings: VisionSettings
) -> list[tuple[Window, FloatArray]]:
    """Windows around connected patches of a colour in a whole picture, the roundest first, with a circle for each.

    The circle (u, v, radius; px) has the patch's middle and area: a ball that stands alone is there already.
    """
    hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
    found: list[tuple[float, Window, FloatArray]] = []
    for level in settings.balls.saturations:
        mask = replace(colour, saturation=min(colour.saturation + level, 0.95)).mask(hsv)
        if not cv2.countNonZero(mask):
            break
        roundest = sorted(_regions(mask, radii), key=lambda region: -region[0])[: settings.balls.patches]
        for region in roundest:  # noise leaves thousands
            u, v, size = region[2]
            if not any(
                np.hypot(u - a, v - b) < 0.4 * min(size, r) + 1.0 and abs(size - r) < 0.25 * max(size, r)
                for _, _, (a, b, r) in found
            ):
                found.append(region)
    found.sort(key=lambda region: -region[0])
    return [(window, circle) for _, window, circle in found[: settings.balls.patches]]


def _regions(mask: Image, radii: tuple[float, float]) -> list[tuple[float, Window, FloatArray]]:
    """Find connected patches of a mask: how round each is, a window around it, a circle of its middle and area."""
    height, width = mask.shape
    closed = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    contours, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    regions = []
    for contour in contours:
        left, top, wide, high = cv2.boundingRect(contour)
        if max(wide, high) < 1.2 * radii[0]:
            continue
        _, around = cv2.minEnclosingCircle(contour)
        area = float(cv2.contourArea(contour))
        size = float(np.sqrt(area / np.pi))
        fits = radii[0] * 0.6 <= size <= radii[1] * 1.2
        margin = int(0.4 * max(wide, high) + 6)
        right, bottom = min(left + wide + margin, width), min(top + high + margin, height)
        window = Window(max(left - margin, 0), max(top - margin, 0), right, bottom)
        roundness = area / (np.pi * around**2 + 1.0) * (1.0 if fits else 0.3)
        regions.append((roundness, window, np.array([left + 0.5 * (wide - 1), top + 0.5 * (high - 1), size])))
    return regions
