"""What an arm weighs."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray, frozen_array

STANDARD_GRAVITY = 9.80665  # m/s^2 (CGPM 1901)


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid link: its mass and where that mass sits.

    Parameters
    ----------
    mass : float
        kg.
    com : (3,) array
        Centre of mass in the link's own frame, m.
    inertia : (3, 3) array
        About the centre of mass, along the link frame's axes, kg m^2; none where it is not known.

    Raises
    ------
    DataError
        The mass is negative, or the centre is not three finite numbers.
    """

    mass: float
    com: FloatArray
    inertia: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))

    def __post_init__(self) -> None:
        object.__setattr__(self, "com", frozen_array(self.com))
        object.__setattr__(self, "inertia", frozen_array(self.inertia))
        if not self.mass >= 0 or self.com.shape != (3,) or not np.isfinite(self.com).all():
            raise DataError(f"a link is a mass >= 0 kg and a centre (3,) m, got {self.mass} and {self.com}.")
