"""What an effect says of itself: parameters with unit, range and usual size, look-alikes, runs that separate them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from math import isfinite, isnan
from typing import Any

import numpy as np

from gpcorrect.errors import DataError


class Family(StrEnum):
    """The classes of the catalogue: what kind of evidence an effect leaves."""

    GEOMETRY = "geometry"
    COMPLIANCE = "compliance"
    REVERSAL = "reversal"
    TIME = "time"
    LIMIT = "limit"
    DYNAMICS = "dynamics"
    NOISE = "noise"


class Run(StrEnum):
    """Recordings that tell look-alikes apart."""

    SPEED_LADDER = "the same path at log-spaced speeds"
    AMPLITUDES = "both directions at several amplitudes"
    HOLD_UNLOAD = "hold, unload, recover"
    LOAD_SWAP = "the same poses with another payload"
    ONE_JOINT = "one joint moves, the others hold"
    POSE_SPREAD = "the same joint value at several poses of the other joints"
    GAIN_CHANGE = "the same path with other controller gains"
    REHOMING = "home again and repeat"
    REFERENCE_RETURNS = "return to one reference pose again and again"
    TWO_INSERTIONS = "the same path at two insertion depths"


class Site(StrEnum):
    """Where an effect may sit: what its `joint` (and `source`) may be."""

    JOINT = "any joint"
    PAIR = "any joint, with any other as source"
    INSERTION = "any joint, with any prismatic one as source"
    ALL = "all"
    TOOL = "tool"
    BASE = "base"


class Per(StrEnum):
    """What the rungs of a ladder are counted in."""

    VALUE = "the parameter's own unit"
    PRIOR = "the prior's typical value"
    RANGE = "the joint's range"
    PLACE = "the joint's range, from its lower end"
    END = "the joint's range, back from the end that the effect is at"
    SWEEP = "rad of phase over the joint's range"
    SESSION = "the session's duration"
    TORQUE = "the largest torque that the joint's controller asks for"


@dataclass(frozen=True)
class Ladder:
    """A few values at which a search should try a parameter that an effect's trace does not simply grow with.

    Parameters
    ----------
    per : Per, what the rungs are counted in
    rungs : tuple of float
    absent : bool
        Whether the effect is also tried without the parameter: at its field's default. Shapes with two such parameters
        at once are left out.
    within : pair of float
        Bounds in the same count, narrower than the parameter's physical range: outside, the effect could stand in for
        something else. An estimate at such a bound is none.
    """

    per: Per
    rungs: tuple[float, ...]
    absent: bool = False
    within: tuple[float, float] | None = None


@dataclass(frozen=True)
class Range:
    """Unit, physical range and usual size of a parameter on one type of joint.

    Parameters
    ----------
    unit : str, SI unit
    low, high : float, values outside are not physical for a surgical cable-driven arm
    typical : float, usual size
    """

    unit: str
    low: float
    high: float
    typical: float


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Parameters
    ----------
    name, meaning : str, field of the effect, and what it is in one phrase
    revolute : Range, unit, range and usual size on a revolute joint
    prismatic : Range, optional, the same on a prismatic joint, where it is another one
    positive : bool, whether negative values have no meaning
    above, at_most : float, bounds of what has a meaning, where they are others than 0 and infinity
    identity : float, the value at which the effect does nothing
    per_session : bool, whether there may be one value a session
    ladder : Ladder or None
        Values to try, for a parameter that shapes the effect's trace; None where the trace grows with the parameter
        (or with its inverse, when it does nothing at infinity).
    only : tuple of str, optional
        Field and values of the choice for which there is such a parameter; with another it does nothing.
    shaped_by : str, name of the parameter without which this one does nothing; empty when there is none
    change_point : bool
        Whether it is an instant at which something happens: the trace does not change smoothly with it.
    period : float or None, after which it means the same again
    valleys : bool
        Whether the misfit has several minima along it, as along the frequency of what rings for some cycles: the final
        fit is started to both sides of where it was found too.
    unbounded : bool
        Whether infinity means something, though the effect does something there and its range and rungs are finite.
    """

    name: str
    meaning: str
    revolute: Range
    prismatic: Range | None = None
    positive: bool = True
    above: float = -np.inf
    at_most: float = np.inf
    identity: float = 0.0
    per_session: bool = False
    ladder: Ladder | None = None
    only: tuple[str, ...] | None = None
    shaped_by: str = ""
    change_point: bool = False
    period: float | None = None
    valleys: bool = False
    unbounded: bool = False

    @property
    def may_be_infinite(self) -> bool:
        """Whether infinity is a value of it, not a slip."""
        rungs = () if self.ladder is None else self.ladder.rungs
        return self.unbounded or np.inf in (self.identity, self.revolute.high, *rungs)

    def range(self, joint_type: str) -> Range:
        """Return the range on a joint of a type.

        Parameters
        ----------
        joint_type : str, "R" or "P"
        """
        return self.prismatic if joint_type == "P" and self.prismatic is not None else self.revolute

    def check(self, effect: str, value: Any) -> None:
        """Refuse what has no meaning: DataError.

        Parameters
        ----------
        effect : str, name of the effect whose number it is
        value : float, or a tuple of one a session
        """
        numbers = value if self.per_session and isinstance(value, tuple) and value else (value,)
        real = all(isinstance(v, float | int) and not isinstance(v, bool) and not isnan(v) for v in numbers)
        bounded = real and (self.may_be_infinite or all(isfinite(v) for v in numbers))
        if not (bounded and all(self._holds(v) for v in numbers)):
            lowest = f" above {self.above:g}" if isfinite(self.above) else " >= 0" if self.positive else ""
            highest = f" and <= {self.at_most:g}" if isfinite(self.at_most) else ""
            wanted = f"a {'' if self.may_be_infinite else 'finite '}number{lowest}{highest}"
            wanted += ", or one a session" if self.per_session else ""
            raise DataError(f"effect {effect}: {self.name} ({self.meaning}) must be {wanted}, got {value!r}.")

    def _holds(self, number: float) -> bool:
        return self.above < number <= self.at_most and (number >= 0 or not self.positive)


def axes(meaning: str, span: Range, only: tuple[str, ...] | None = None, shaped_by: str = "") -> tuple[Parameter, ...]:
    """Return the parameters x, y and z of a vector, to either side of nothing.

    Parameters
    ----------
    meaning : str, what each is along, but for the axis
    span : Range, of each
    only, shaped_by : as of :class:`Parameter`
    """
    words = {axis: f"{meaning} {axis} axis" for axis in "xyz"}
    return tuple(Parameter(a, w, span, positive=False, only=only, shaped_by=shaped_by) for a, w in words.items())


PHASE = Parameter(
    "phase",
    "phase at zero",
    Range("rad", -np.pi, np.pi, 1.0),
    positive=False,
    ladder=Ladder(Per.VALUE, (0.0, np.pi / 2)),
    period=2 * np.pi,
)
"""Of a wave: every effect that has one."""


@dataclass(frozen=True)
class Description:
    """The catalogue entry of an effect.

    Parameters
    ----------
    name : str, canonical name
    number : int, place in the catalogue: effects of one stage act in this order
    family : Family
    equation, source : str, minimal equation, and where it comes from
    parameters : tuple of Parameter
    neighbours : tuple of str, names of its look-alikes; docs/simulator.md says what separates them
    separating_runs : tuple of Run, recordings that separate it from them
    needs : tuple of str, log signals without which it leaves no trace; alternatives are joined by "|"
    sites : tuple of Site
        Where it may sit; empty leaves that to whoever puts it there, and a search leaves it out.
    choices : tuple of (field, values)
        Fields that are no numbers, and what they may be; other values are refused.
    remote_centre : bool, whether only an arm that pivots about a remote centre of motion can have it
    carries_over : bool
        Whether it remembers what happened in pauses between runs, which no log holds, so that the same machine may show
        more or less of it in one run than in another.
    turned_load : bool, whether it is told from an offset only where the joint's load changes sign
    loaded : (field, value) or empty, a choice that shows only where controllers carry links that weigh something
    """

    name: str
    number: int
    family: Family
    equation: str
    source: str
    parameters: tuple[Parameter, ...]
    neighbours: tuple[str, ...]
    separating_runs: tuple[Run, ...]
    needs: tuple[str, ...] = ("measured_jp|setpoint_jp", "external_jp|tracker_cp")
    sites: tuple[Site, ...] = (Site.JOINT,)
    choices: tuple[tuple[str, tuple[str, ...]], ...] = ()
    remote_centre: bool = False
    carries_over: bool = False
    turned_load: bool = False
    loaded: tuple[str, ...] = ()
