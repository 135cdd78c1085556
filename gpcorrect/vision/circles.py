"""Circles of one colour in a window: Canny edges inside the enlarged colour mask, then Hough with a bisected threshold.

Peng et al. 2020: the accumulator's threshold is the one at which k circles are found and k + 1 just not; where the
count jumps over k, the picture is blurred a little more and the search starts again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.types import FloatArray
from gpcorrect.vision.colour import Colour
from gpcorrect.vision.opencv import Image, cv2

__all__ = ["Window", "bisected_circles", "border_edges", "colour_regions", "find_circles", "whole"]

RIM_SHARE = 0.25  # of the ring inside a circle that must have the ball's colour (the paper's 25 %)
WORKING_RADIUS = 12.0  # px: smaller balls are enlarged before Hough, larger ones shrunk, so that one setting serves all
BLURS = (1.0, 1.6, 2.4)  # px, at working size; the next only where the count jumps
LEAST_ACCUMULATOR, MOST_ACCUMULATOR = 4.0, 100.0
FINE = 1.0  # step at which the bisection stops
MAX_REGIONS = 6
STRONGER = (0.0, 0.15, 0.3, 0.42)  # saturation above the least one: a ball stands out of a background of its own hue


@dataclass(frozen=True)
class Window:
    """Part of a picture: left, top, right, bottom in pixels."""

    left: int
    top: int
    right: int
    bottom: int

    def cut(self, image: Image) -> Image:
        """Return the part of the picture."""
        return image[self.top : self.bottom, self.left : self.right]

    @classmethod
    def around(cls, centre: FloatArray, reach: float, image: Image) -> Window:
        """Return a square window, cut off at the picture's border; it may be empty."""
        height, width = image.shape[:2]
        left, top = (int(np.clip(c - reach, 0, limit)) for c, limit in zip(centre, (width, height), strict=True))
        right, bottom = (
            int(np.clip(c + reach + 1, 0, limit)) for c, limit in zip(centre, (width, height), strict=True)
        )
        return cls(left, top, right, bottom)

    @property
    def empty(self) -> bool:
        """Whether it holds too little for a ball."""
        return self.right - self.left < 6 or self.bottom - self.top < 6


def whole(image: Image) -> Window:
    """Return the window that is the whole picture."""
    return Window(0, 0, image.shape[1], image.shape[0])


def find_circles(
    image: Image, colour: Colour, window: Window, radii: tuple[float, float], count: int = 1
) -> list[FloatArray]:
    """Return up to `count` circles (u, v, radius; px) of a colour in a window of a picture.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Blue green red.
    colour : Colour
        Of the ball.
    window : Window
        Where to look.
    radii : (2,) tuple
        Least and greatest radius, px.
    count : int
        How many there are.
    """
    if window.empty:
        return []
    part = window.cut(image)
    middle = float(np.sqrt(radii[0] * min(radii[1], 4 * radii[0])))
    scale = float(np.clip(WORKING_RADIUS / middle, 0.25, 4.0))
    if abs(scale - 1.0) > 0.25:
        how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
        part = cv2.resize(part, None, fx=scale, fy=scale, interpolation=how)
    else:
        scale = 1.0
    mask = colour.mask(cv2.cvtColor(part, cv2.COLOR_BGR2HSV))
    if not cv2.countNonZero(mask):
        return []
    low, high = max(scale * radii[0], 2.0), max(scale * radii[1], scale * radii[0] + 2.0)
    found = [c for c in bisected_circles(part, mask, (low, high), count) if _has_colour(mask, c)]
    shift = np.array([window.left, window.top])
    return [np.array([*((c[:2] + 0.5) / scale - 0.5 + shift), c[2] / scale]) for c in found]


def border_edges(part: Image, mask: Image, blur: float) -> Image:
    """Edges of the grey picture that lie at the border of the colour mask: the product of the two."""
    grey = cv2.GaussianBlur(cv2.cvtColor(part, cv2.COLOR_BGR2GRAY), (0, 0), blur)
    edges = cv2.bitwise_or(cv2.Canny(grey, 20, 50), _outline(mask))
    enlarged = cv2.dilate(mask, np.ones((7, 7), np.uint8))
    return cv2.bitwise_and(edges, enlarged)


def _outline(mask: Image) -> Image:
    """Border of the mask itself: what remains of the rim where ball and background are equally bright."""
    return cv2.morphologyEx(mask, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8))


def bisected_circles(part: Image, mask: Image, radii: tuple[float, float], count: int) -> list[FloatArray]:
    """Circles with the accumulator threshold at which `count` are found and one more just not."""
    found: list[FloatArray] = []
    for blur in BLURS:
        picture = cv2.GaussianBlur(border_edges(part, mask, blur), (0, 0), blur)
        found = _at_threshold(picture, radii, count)
        if len(found) <= count:
            return found
    return found[:count]  # the number jumps at every blur: the strongest ones


def _at_threshold(picture: Image, radii: tuple[float, float], count: int) -> list[FloatArray]:
    """Bisect: the highest threshold that still leaves `count` circles; more than `count` where the number jumps."""
    low, high = LEAST_ACCUMULATOR, MOST_ACCUMULATOR
    found = _hough(picture, radii, low)
    if len(found) <= count:
        return found
    while high - low > FINE:
        middle = 0.5 * (low + high)
        now = _hough(picture, radii, middle)
        if len(now) == count:
            return now
        if len(now) > count:
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


def _has_colour(mask: Image, circle: FloatArray) -> bool:
    """Check the rim's colour: enough of the ring just inside the circle is of the colour."""
    height, width = mask.shape
    angles = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    hits, seen = 0, 0
    for share in (0.6, 0.75, 0.9):
        u = np.rint(circle[0] + share * circle[2] * np.cos(angles)).astype(int)
        v = np.rint(circle[1] + share * circle[2] * np.sin(angles)).astype(int)
        inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
        hits += int(np.count_nonzero(mask[v[inside], u[inside]]))
        seen += len(angles)
    return hits >= RIM_SHARE * seen


def colour_regions(image: Image, colour: Colour, radii: tuple[float, float]) -> list[tuple[Window, FloatArray]]:
    """Windows around connected patches of a colour in a whole picture, the roundest first, with a circle for each.

    Where to look for a ball about whose place nothing is known. The circle (u, v, radius; px) has the patch's middle
    and area: a ball that stands alone is there already.
    """
    hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
    found: list[tuple[float, Window, FloatArray]] = []
    for level in STRONGER:
        floor = min(colour.saturation + level, 0.95)
        mask = replace(colour, saturation=floor).mask(hsv)
        if not cv2.countNonZero(mask):
            break
        for region in _regions(mask, radii):
            if not any(_alike(region[2], other[2]) for other in found):
                found.append(region)
    found.sort(key=lambda region: -region[0])
    return [(window, circle) for _, window, circle in found[:MAX_REGIONS]]


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
        window = Window(
            max(left - margin, 0),
            max(top - margin, 0),
            min(left + wide + margin, width),
            min(top + high + margin, height),
        )
        roundness = area / (np.pi * around**2 + 1.0) * (1.0 if fits else 0.3)
        regions.append((roundness, window, np.array([left + 0.5 * (wide - 1), top + 0.5 * (high - 1), size])))
    return regions


def _alike(a: FloatArray, b: FloatArray) -> bool:
    """Whether two patches' circles are one."""
    near = float(np.linalg.norm(a[:2] - b[:2])) < 0.4 * min(a[2], b[2]) + 1.0
    return near and bool(abs(a[2] - b[2]) < 0.25 * max(a[2], b[2]))
