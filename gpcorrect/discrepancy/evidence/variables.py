"""What a residual may depend on: variables of the motor side, and the cells of small tests over one or two of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations, pairwise, product

import numpy as np

from gpcorrect.discrepancy.recording.scene import Scene
from gpcorrect.discrepancy.settings import TESTS
from gpcorrect.sim.effects import lag, play
from gpcorrect.types import FloatArray, IntArray

BINS = {1: 8, 2: 5}
PLAYS = (0.01, 0.04, 0.16)  # half widths over a joint's travel: what Preisach's weights are sampled at
LAGS = (0.1, 1.0, 10.0)  # s


class Quantity(StrEnum):
    """Kinds of variables; those of the motion belong to a joint."""

    POSITION = "position"
    DIRECTION = "direction"
    SPEED = "speed"
    TIME_SINCE_REVERSAL = "time since reversal"
    WAY_SINCE_REVERSAL = "way since reversal"
    ACCELERATION = "acceleration"
    LOAD = "load"
    EFFORT = "effort"
    TIME_IN_TRAJECTORY = "time in trajectory"
    SESSION_TIME = "session time"
    SESSION = "session"
    FREQUENCY = "frequency"


@dataclass(frozen=True)
class Variable:
    """A quantity, and the joint that it is of; None for one of no joint."""

    quantity: Quantity
    joint: int | None = None

    def __str__(self) -> str:
        return str(self.quantity) if self.joint is None else f"{self.quantity} {self.joint}"


@dataclass(frozen=True, eq=False)
class Covariates:
    """Variables for one joint's channel, from the motor side only, so that no truth leaks into them.

    Parameters
    ----------
    values : dict of Variable to (n,) array
        Those that do not vary are left out.
    primary : tuple of Variable
        Those that are tested together with every other one.
    units : dict of Variable to str
        SI units; empty for pure numbers.
    memory : tuple of (n,) arrays
        What plays of a few half widths and lags of a few time constants leave of the motors' path and load: what has a
        memory, of whatever kind, is a function of such states (Preisach's operator is an integral over plays).
    """

    values: dict[Variable, FloatArray]
    primary: tuple[Variable, ...]
    units: dict[Variable, str]
    memory: tuple[FloatArray, ...] = ()


def travel_direction(path: FloatArray, run: IntArray) -> FloatArray:
    """Return the direction `(n,)` of the last move larger than the resolution, -1 or 1; 0 before the first one.

    Parameters
    ----------
    path : (n,) array
        rad or m.
    run : (n,) int array
        Continuous motion that each row belongs to.
    """
    threshold = TESTS.resolution * float(np.ptp(path))
    direction = np.zeros(len(path))
    for k in np.unique(run):
        rows = np.flatnonzero(run == k)
        anchor, current = path[rows[0]], 0.0
        for row in rows:
            if abs(path[row] - anchor) > threshold:
                current = float(np.sign(path[row] - anchor))
                anchor = path[row]
            elif current * (path[row] - anchor) > 0:
                anchor = path[row]
            direction[row] = current
    return direction


def _since_reversal(
    time: FloatArray, path: FloatArray, direction: FloatArray, run: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Seconds `(n,)` and way `(n,)` since the last reversal (or start) of each run."""
    turned = np.r_[True, (direction[1:] != direction[:-1]) | (run[1:] != run[:-1])]
    last = np.maximum.accumulate(np.where(turned, np.arange(len(path)), 0))
    return time - time[last], np.abs(path - path[last])


def covariates_of(scene: Scene, joint_index: int | None) -> Covariates:
    """Return the variables of a channel.

    Parameters
    ----------
    scene : Scene
        Recording and simulator.
    joint_index : int or None
        Column of the channel's joint; None for a channel of all joints.
    """
    motor, label, load = scene.motor_path(), scene.run_of_row(), scene.load()
    values: dict[Variable, FloatArray] = {}
    primary: list[Variable] = []
    columns = range(len(scene.joints)) if joint_index is None else [joint_index]
    speed = scene.layout.gather(scene.motion.velocity)
    for j in columns:
        joint = scene.joints[j]
        direction = travel_direction(motor[:, j], label)
        since, way = _since_reversal(scene.time, motor[:, j], direction, label)
        values |= {
            Variable(Quantity.POSITION, joint): motor[:, j],
            Variable(Quantity.DIRECTION, joint): direction,
            Variable(Quantity.SPEED, joint): np.abs(speed[:, j]),
            Variable(Quantity.TIME_SINCE_REVERSAL, joint): since,
            Variable(Quantity.WAY_SINCE_REVERSAL, joint): direction * way,
            Variable(Quantity.ACCELERATION, joint): _acceleration(scene.time, speed[:, j], label),
            Variable(Quantity.LOAD, joint): load[:, j],
        }
        if scene.effort is not None:
            values[Variable(Quantity.EFFORT, joint)] = scene.effort[:, j]
        primary += [Variable(Quantity.POSITION, joint), Variable(Quantity.DIRECTION, joint)]
    for k, number in enumerate(scene.joints):
        if k not in columns:
            values[Variable(Quantity.POSITION, number)] = motor[:, k]
            values[Variable(Quantity.DIRECTION, number)] = travel_direction(motor[:, k], label)
    values |= _times(scene)
    varying = {variable: v for variable, v in values.items() if np.nanstd(v) > 0}
    units = {variable: _unit(variable, scene) for variable in varying}
    memory = [state for j in columns for state in _memories(scene, j)]
    return Covariates(
        varying, tuple(p for p in primary if p in varying), units, tuple(m for m in memory if np.nanstd(m) > 0)
    )


def _memories(scene: Scene, j: int) -> list[FloatArray]:
    """States of plays and lags of a joint's motors, at the log's rows."""
    motion = scene.motion
    path, load = motion.position[..., j], scene.layout.spread(scene.load()[:, j])
    span = float(np.ptp(scene.motor_path()[:, j]))
    states = [path - play(path, radius * span) for radius in PLAYS]
    states += [x - lag(x, motion.time, seconds, motion.session) for x in (path, load) for seconds in LAGS]
    return [scene.layout.gather(state) for state in states]


def _unit(variable: Variable, scene: Scene) -> str:
    """SI unit of a variable: that of its joint, of its kind."""
    match variable.quantity:
        case Quantity.SESSION | Quantity.DIRECTION:
            return ""
        case Quantity.TIME_IN_TRAJECTORY | Quantity.SESSION_TIME | Quantity.TIME_SINCE_REVERSAL:
            return "s"
    slides = variable.joint is not None and scene.machine.body.types[scene.joints.index(variable.joint)] == "P"
    length, force = ("m", "N") if slides else ("rad", "N m")
    match variable.quantity:
        case Quantity.SPEED:
            return f"{length}/s"
        case Quantity.ACCELERATION:
            return f"{length}/s^2"
        case Quantity.LOAD | Quantity.EFFORT:
            return force
        case _:
            return length


def _acceleration(time: FloatArray, speed: FloatArray, run: IntArray) -> FloatArray:
    change = np.zeros(len(time))
    inside = run[1:] == run[:-1]
    step = np.diff(time)
    change[1:] = np.where(inside & (step > 0), np.diff(speed) / np.where(step > 0, step, 1.0), 0.0)
    return change


def _times(scene: Scene) -> dict[Variable, FloatArray]:
    first = np.r_[True, scene.trajectory[1:] != scene.trajectory[:-1]]
    start = np.maximum.accumulate(np.where(first, np.arange(len(scene)), 0))
    clock = scene.layout.gather(scene.motion.time)
    values = {
        Variable(Quantity.TIME_IN_TRAJECTORY): scene.time - scene.time[start],
        Variable(Quantity.SESSION_TIME): clock,
    }
    if scene.n_sessions > 1:
        values[Variable(Quantity.SESSION)] = scene.session.astype(np.float64)
    return values


@dataclass(frozen=True)
class Span:
    """Where a cell lies along one variable: from `low` to `high`, which are the same for one of few values."""

    variable: Variable
    low: float
    high: float
    unit: str


@dataclass(frozen=True, eq=False)
class Cells:
    """The cells of one test.

    Parameters
    ----------
    variables : tuple of Variable
        One or two of them.
    code : (n,) int array
        Cell of each row.
    spans : tuple of tuple of Span
        Where each cell lies, a span for each variable.
    """

    variables: tuple[Variable, ...]
    code: IntArray
    spans: tuple[tuple[Span, ...], ...]

    def indicator(self, rows: IntArray) -> FloatArray:
        """Return columns `(len(rows), k)`, one for each cell, 1 where a row is in it.

        Parameters
        ----------
        rows : int array
            Of the n rows.
        """
        columns = np.zeros((len(rows), len(self.spans)))
        columns[np.arange(len(rows)), self.code[rows]] = 1.0
        return columns


def all_cells(covariates: Covariates) -> list[Cells]:
    """Return tests of every variable alone, and of the channel's own position and direction with every other one.

    Parameters
    ----------
    covariates : Covariates
        Of the channel.
    """
    names = list(covariates.values)
    pairs = [(a, b) for a, b in combinations(names, 2) if a in covariates.primary or b in covariates.primary]
    wanted = [*((name,) for name in names), *pairs][: TESTS.max_tests]
    return [cells_of({v: covariates.values[v] for v in variables}, covariates.units) for variables in wanted]


def cells_of(values: Mapping[Variable, FloatArray], units: Mapping[Variable, str] | None = None) -> Cells:
    """Cut one variable in 8 cells, or two in 5 by 5, that hold equally many rows; one of few values keeps them.

    Parameters
    ----------
    values : mapping of Variable to (n,) array
        One or two.
    units : mapping, optional
        SI units; pure numbers have none.
    """
    n_bins = BINS[len(values)]
    codes, spans = [], []
    for variable, column in values.items():
        code, ends = _cut(column, n_bins)
        codes.append(code)
        spans.append([Span(variable, low, high, (units or {}).get(variable, "")) for low, high in ends])
    if len(codes) == 1:
        return Cells(tuple(values), codes[0], tuple((span,) for span in spans[0]))
    return Cells(tuple(values), codes[0] * len(spans[1]) + codes[1], tuple(product(*spans)))


def _cut(values: FloatArray, n_bins: int) -> tuple[IntArray, list[tuple[float, float]]]:
    distinct = np.unique(values)
    if len(distinct) <= n_bins:
        return np.searchsorted(distinct, values).astype(np.int64), [(float(v), float(v)) for v in distinct]
    edges = np.unique(np.quantile(values, np.linspace(0, 1, n_bins + 1)))
    code = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    return code.astype(np.int64), [(float(a), float(b)) for a, b in pairwise(edges)]
