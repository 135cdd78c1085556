"""What counts as a ball's colour: a range of hues, strong enough and bright enough to have one."""

from __future__ import annotations

import colorsys
import re
from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.vision.opencv import Image, cv2

__all__ = ["COLOURS", "Colour", "colour_of", "hue_name"]

TURN = 360.0
SATURATION, VALUE = 0.30, 0.12  # below, a hue is noise
TOLERANCE = 22.0  # degrees to either side of a hue that was given as a number
LEAST_GAP = 1.0  # degrees between two balls' ranges


@dataclass(frozen=True)
class Colour:
    """A range of colours.

    Parameters
    ----------
    hue : float
        Middle of the range, degrees: red 0, yellow 60, green 120, blue 240.
    tolerance : float
        Degrees to either side.
    saturation, value : float
        Least of each, 0 to 1.
    """

    hue: float
    tolerance: float
    saturation: float = SATURATION
    value: float = VALUE

    def meets(self, other: Colour) -> bool:
        """Whether two ranges overlap."""
        apart = abs((self.hue - other.hue + TURN / 2) % TURN - TURN / 2)
        return apart < self.tolerance + other.tolerance - LEAST_GAP

    def mask(self, hsv: Image) -> Image:
        """Mark (uint8, 255 or 0) pixels of a picture in HSV, as OpenCV has it, that are of the colour."""
        low, high = self.hue - self.tolerance, self.hue + self.tolerance
        floor = (255 * self.saturation, 255 * self.value)
        mask = None
        for shift in (-TURN, 0.0, TURN):
            first, last = max(low + shift, 0.0) / 2, min(high + shift, TURN - 1e-9) / 2
            if first > last:
                continue
            part = cv2.inRange(hsv, (first, *floor), (last, 255, 255))
            mask = part if mask is None else cv2.bitwise_or(mask, part)
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


def colour_of(
    given: str | float | tuple[int, int, int],
    *,
    tolerance: float | None = None,
    saturation: float | None = None,
    value: float | None = None,
) -> Colour:
    """Return the range of a named colour, a hue in degrees, "#rrggbb", or (red, green, blue) of 0 to 255.

    Raises
    ------
    DataError
        The name is unknown, or the colour is grey.
    """
    colour = _base(given)
    changes = {"tolerance": tolerance, "saturation": saturation, "value": value}
    return replace(colour, **{name: v for name, v in changes.items() if v is not None})


def _base(given: str | float | tuple[int, int, int]) -> Colour:
    if isinstance(given, str):
        if re.fullmatch("#[0-9a-fA-F]{6}", given):
            return _base((int(given[1:3], 16), int(given[3:5], 16), int(given[5:7], 16)))
        if given.lower() not in COLOURS:
            raise DataError(
                f"the colour {given!r} has no name here.",
                hint=f'Say one of {", ".join(COLOURS)}, a "hue" in degrees, or "#rrggbb".',
            )
        return COLOURS[given.lower()]
    if isinstance(given, tuple | list):
        hue, saturation, _ = colorsys.rgb_to_hsv(*(np.clip(given, 0, 255) / 255.0))
        if saturation < SATURATION / 2:
            raise DataError(f"the colour {tuple(given)} is nearly grey: it cannot be told from the background.")
        return Colour(TURN * hue, TOLERANCE, min(SATURATION, 0.5 * saturation))
    return Colour(float(given) % TURN, TOLERANCE)


def hue_name(hue: float) -> str:
    """Name of the colour range that a hue (degrees) is nearest to."""
    return min(
        COLOURS, key=lambda name: abs((hue - COLOURS[name].hue + TURN / 2) % TURN - TURN / 2) / COLOURS[name].tolerance
    )
