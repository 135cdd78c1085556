"""Parameters as an optimiser wants them: of order one, inside bounds, amplitudes that can go through the identity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect.sim.effects import Parameter

WIDEST = np.log(1e6)  # of a shape parameter's logarithm around its typical value
PRIOR_LOG = np.log(3.0)  # standard deviation of a shape parameter's logarithm: a factor of three either way
PRIOR_WIDTH = 2 * 1.96 * PRIOR_LOG  # of its 95 % interval


@dataclass(frozen=True)
class Coordinate:
    """How one parameter is stretched, by its typical value and range on this type of joint."""

    parameter: Parameter
    kind: str  # "scaled" (in units of typical), "inverse" (typical over value, as of a stiffness) or "log"
    typical: float
    low: float
    high: float
    unit: str
    amplitude: bool  # whether the effect grows with it
    narrowed: bool = False  # to less than the parameter's physical range in this recording

    @property
    def width(self) -> float:
        """Width of what it may be: of a period at most, and of its prior where a logarithm's range begins at zero."""
        low, high = self.bounds
        if self.kind == "log" and self.low <= 0.0:
            return float(min(high - low, PRIOR_WIDTH))
        period = self.parameter.period
        return high - low if period is None else min(high - low, period / self.typical)

    @property
    def identity(self) -> float:
        """Coordinate at which the effect does nothing."""
        if self.kind == "log":
            return -np.inf
        return 0.0 if self.kind == "inverse" else self.parameter.identity / self.typical

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of the coordinate; what turns has none, for a wave far from zero may have to turn it many times."""
        if self.parameter.period is not None:
            return -np.inf, np.inf
        low, high = self.coordinate(self.low), self.coordinate(self.high)
        if self.kind == "inverse":
            return high, low
        return (max(low, -WIDEST), min(high, WIDEST)) if self.kind == "log" else (low, high)

    def value(self, u: float) -> float:
        """Return the parameter at a coordinate.

        Parameters
        ----------
        u : float
        """
        if self.kind == "inverse":
            return self.typical / u if u > 0 else float("inf")
        if self.kind == "log":
            return float(self.typical * np.exp(u))
        return self.typical * u

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value.

        Parameters
        ----------
        value : float
        """
        if self.kind == "inverse":
            return self.typical / value
        if self.kind == "log":
            return float(np.log(max(value, 1e-300) / self.typical))
        return value / self.typical

    @property
    def prior_weight(self) -> float:
        """One over the prior standard deviation of a coordinate in a fit; 0 where it is left free.

        Sizes of either sign have one as wide as their physical range: it moves none that the data say anything of, and
        those that they do not see, such as a turn that the marker's own takes up, stay at nothing.
        """
        if self.parameter.change_point:
            return 0.0
        if self.amplitude:
            return self.typical / (self.high - self.low) if self.kind == "scaled" and self.low < 0.0 else 0.0
        return 1.0 / PRIOR_LOG if self.kind == "log" else 0.0


def coordinate_of(parameter: Parameter, joint_type: str, *, amplitude: bool) -> Coordinate:
    """Choose the coordinate of a parameter on a joint of this type.

    Parameters
    ----------
    parameter : Parameter
    joint_type : str, "R" or "P"
    amplitude : bool, whether the effect grows with it
    """
    span = parameter.range(joint_type)
    if np.isinf(parameter.identity):
        kind = "inverse"
    elif parameter.positive and not amplitude and span.typical > 0:
        kind = "log"
    else:
        kind = "scaled"
    return Coordinate(parameter, kind, span.typical or 1.0, span.low, span.high, span.unit, amplitude)
