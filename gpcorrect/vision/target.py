"""What is tracked: colours, and balls of a colour at known places on the tool."""

from __future__ import annotations

import colorsys
import itertools
import re
from dataclasses import dataclass

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray
from gpcorrect.vision.opencv import Image, cv2

TURN = 360.0  # degrees
LEAST_SATURATION, LEAST_VALUE = 0.30, 0.12  # docs/vision.md: below, the hue of a pixel is mostly noise
HUE_TOLERANCE = 22.0  # degrees to either side of a hue given as a number: about what red and yellow have
LEAST_GAP = 1.0  # degrees by which two balls' ranges may overlap: half a step of OpenCV's hue
THIN = 0.05  # second over first singular value of the places: a flatter triangle leaves the turn about its axis open
ARM = 0.038  # m from the holder's centre to each ball's: the fixture of Peng et al. 2020; its balls have 20 mm


@dataclass(frozen=True)
class Colour:
    """A range of hues, strong enough and bright enough to have one.

    Parameters
    ----------
    hue : float, middle of the range, degrees: red 0, yellow 60, green 120, blue 240
    tolerance : float, degrees to either side
    saturation, value : float, least of each, 0 to 1
    """

    hue: float
    tolerance: float
    saturation: float = LEAST_SATURATION
    value: float = LEAST_VALUE

    def mask(self, hsv: Image) -> Image:
        """Mark the pixels that are of the colour: 255 where it is, 0 elsewhere.

        Parameters
        ----------
        hsv : (height, width, 3) uint8 array, hue, saturation and value as OpenCV has them
        """
        floor = (255 * self.saturation, 255 * self.value)
        mask = np.zeros(hsv.shape[:2], np.uint8)
        for shift in (-TURN, 0.0, TURN):  # a range may cross hue zero
            first = max(self.hue - self.tolerance + shift, 0.0) / 2
            last = min(self.hue + self.tolerance + shift, TURN - 1e-9) / 2
            if first <= last:
                mask |= cv2.inRange(hsv, (first, *floor), (last, 255, 255))
        return mask


# The ranges meet where people stop calling a colour by its name; orange lies between red and yellow.
COLOURS = {
    "red": Colour(350.0, 28.0),
    "orange": Colour(32.0, 12.0),
    "yellow": Colour(54.0, 17.0),
    "green": Colour(125.0, 52.0),
    "cyan": Colour(185.0, 18.0),
    "blue": Colour(225.0, 30.0),
    "purple": Colour(275.0, 20.0),
    "pink": Colour(320.0, 22.0),
}


def _hue_apart(a: float, b: float) -> float:
    """Degrees between two hues, 0 to 180."""
    return abs((a - b + TURN / 2) % TURN - TURN / 2)


def hue_name(hue: float) -> str:
    """Name the colour range that a hue is nearest to.

    Parameters
    ----------
    hue : float, degrees
    """
    return min(COLOURS, key=lambda name: _hue_apart(hue, COLOURS[name].hue) / COLOURS[name].tolerance)


def colour_of(given: str | float | tuple[int, int, int]) -> Colour:
    """Return the range of a colour.

    Parameters
    ----------
    given : str, float or tuple
        A name, a hue in degrees, "#rrggbb", or (red, green, blue) of 0 to 255.

    Raises
    ------
    DataError
        The name is unknown, or the colour is grey.
    """
    if isinstance(given, str):
        if re.fullmatch("#[0-9a-fA-F]{6}", given):
            return colour_of((int(given[1:3], 16), int(given[3:5], 16), int(given[5:7], 16)))
        if given.lower() not in COLOURS:
            hint = f'Say one of {", ".join(COLOURS)}, a "hue" in degrees, or "#rrggbb".'
            raise DataError(f"the colour {given!r} has no name here.", hint=hint)
        return COLOURS[given.lower()]
    if isinstance(given, tuple | list):
        hue, saturation, _ = colorsys.rgb_to_hsv(*(np.clip(given, 0, 255) / 255.0))
        if saturation < LEAST_SATURATION / 2:
            raise DataError(f"the colour {tuple(given)} is nearly grey: it does not stand out of the background.")
        return Colour(TURN * hue, HUE_TOLERANCE, min(LEAST_SATURATION, 0.5 * saturation))
    return Colour(float(given) % TURN, HUE_TOLERANCE)


@dataclass(frozen=True, eq=False)
class BallSpec:
    """One ball.

    Parameters
    ----------
    name : str, for columns and messages
    colour : Colour, hues it may show
    place : (3,) tuple, its centre in the tool frame, m
    radius : float or None, m; None when not known: then no size is checked
    """

    name: str
    colour: Colour
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius: float | None = None


@dataclass(frozen=True, eq=False)
class Target:
    """The balls of a tool; three give its pose, one or two only positions.

    Parameters
    ----------
    balls : tuple of BallSpec, with different names and colours; three or more not on a line; else a DataError
    """

    balls: tuple[BallSpec, ...]

    def __post_init__(self) -> None:
        if not self.names or len(set(self.names)) < len(self.names):
            raise DataError(f"a target has balls with different names; got {', '.join(self.names) or 'none'}.")
        for a, b in itertools.combinations(self.balls, 2):
            if _hue_apart(a.colour.hue, b.colour.hue) < a.colour.tolerance + b.colour.tolerance - LEAST_GAP:
                hint = "Give each ball its own hue, 20 degrees or more from the others', or narrower tolerances."
                raise DataError(f"balls {a.name} and {b.name} have colours that cannot be distinguished.", hint=hint)
        if self.has_pose:
            first, second, _ = np.linalg.svd(self.places - self.places.mean(axis=0), compute_uv=False)
            if second <= THIN * first:
                hint = "Place them in a triangle."
                raise DataError("the balls lie on a line, which determines no orientation.", hint=hint)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the balls, in order."""
        return tuple(ball.name for ball in self.balls)

    @property
    def places(self) -> FloatArray:
        """Centres `(b, 3)` in the tool frame, m."""
        return np.array([ball.place for ball in self.balls], dtype=np.float64)

    @property
    def has_pose(self) -> bool:
        """Whether the balls determine an orientation."""
        return len(self.balls) >= 3


END_EFFECTOR = Target(
    (
        BallSpec("green", COLOURS["green"], (0.0, -ARM, 0.0)),
        BallSpec("yellow", COLOURS["yellow"], (ARM, 0.0, 0.0)),
        BallSpec("red", COLOURS["red"], (0.0, ARM, 0.0)),
    )
)


def single_ball(colour: str = "red") -> Target:
    """Return a target of one ball of unknown size at the tool's origin.

    Parameters
    ----------
    colour : str, as in :func:`colour_of`, as are the errors
    """
    return Target((BallSpec(colour, colour_of(colour)),))
