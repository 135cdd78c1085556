"""What is tracked: coloured balls and where they sit on the tool."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray
from gpcorrect.vision.camera_file import problems, read_table
from gpcorrect.vision.colour import COLOURS, Colour, colour_of

__all__ = ["END_EFFECTOR", "BallSpec", "Target", "read_target", "single_ball", "target_from_dict"]

ARM = 0.033  # m from the holder's centre to each ball's: the fixture of Peng et al. 2020
HINT = "docs/vision.md shows a target file."
STRAIGHT = 0.05  # of a triangle's longest side: flatter ones determine no pose


@dataclass(frozen=True, eq=False)
class BallSpec:
    """One ball.

    Parameters
    ----------
    name : str
        For columns and messages.
    colour : Colour
        Hues it may show.
    place : (3,) tuple
        Its centre in the tool frame, m.
    radius : float or None
        m; None when not known: then no size is checked.
    """

    name: str
    colour: Colour
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius: float | None = None


@dataclass(frozen=True, eq=False)
class Target:
    """The balls of a tool; three give its pose, one or two only positions."""

    balls: tuple[BallSpec, ...]

    def __post_init__(self) -> None:
        names = [ball.name for ball in self.balls]
        if not names or len(set(names)) < len(names):
            raise DataError(f"a target has balls with different names; got {', '.join(names) or 'none'}.")
        clash = [
            (a.name, b.name) for i, a in enumerate(self.balls) for b in self.balls[i + 1 :] if a.colour.meets(b.colour)
        ]
        if clash:
            raise DataError(
                f"balls {clash[0][0]} and {clash[0][1]} have colours that cannot be told apart.",
                hint="Give each ball its own hue, 20 degrees or more from the others', or narrower tolerances.",
            )
        if len(self.balls) >= 3 and _thinness(self.places) < STRAIGHT:
            raise DataError(
                "the balls lie on a line, which determines no orientation.", hint="Place them in a triangle."
            )

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


def _thinness(places: FloatArray) -> float:
    """Second singular value of the centred places over the first."""
    values = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    return float(values[1] / values[0]) if values[0] > 0 else 0.0


END_EFFECTOR = Target(
    (
        BallSpec("green", COLOURS["green"], (0.0, -ARM, 0.0)),
        BallSpec("yellow", COLOURS["yellow"], (ARM, 0.0, 0.0)),
        BallSpec("red", COLOURS["red"], (0.0, ARM, 0.0)),
    )
)


def single_ball(colour: str = "red", radius: float | None = None) -> Target:
    """Return a target of one ball at the tool's origin."""
    return Target((BallSpec(colour, colour_of(colour), (0.0, 0.0, 0.0), radius),))


class _Ball(BaseModel):
    model_config = ConfigDict(extra="forbid")
    name: str = Field(min_length=1, pattern=r"^\w+$")
    color: str | tuple[int, int, int] | None = None
    hue: float | None = None
    hue_tolerance: Annotated[float, Field(gt=0, le=90)] | None = None
    least_saturation: Annotated[float, Field(ge=0, lt=1)] | None = None
    least_value: Annotated[float, Field(ge=0, lt=1)] | None = None
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    radius: Annotated[float, Field(gt=0)] | None = None

    def spec(self) -> BallSpec:
        colour = colour_of(
            self.hue if self.hue is not None else self.color if self.color is not None else self.name,
            tolerance=self.hue_tolerance,
            saturation=self.least_saturation,
            value=self.least_value,
        )
        return BallSpec(self.name, colour, self.place, self.radius)


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid")
    ball: Annotated[tuple[_Ball, ...], Field(min_length=1)]


def target_from_dict(values: Mapping[str, object] | Sequence[object], source: str = "target") -> Target:
    """Check plain values and return the target.

    Raises
    ------
    DataError
        A key is unknown or missing, a value has the wrong type or range, or the balls determine nothing.
    """
    try:
        return Target(tuple(ball.spec() for ball in _File.model_validate(values).ball))
    except ValidationError as error:
        raise DataError(f"{source} is no target file: {problems(error)}.", hint=HINT) from error


def read_target(path: str | Path) -> Target:
    """Read a target file (TOML or JSON): a `[[ball]]` table for each ball.

    Raises
    ------
    DataError
        As :func:`target_from_dict`, or the file cannot be read.
    """
    return target_from_dict(read_table(path, "target file", HINT), str(path))
