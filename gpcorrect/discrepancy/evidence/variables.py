"""What a residual may depend on: variables of the motor side, and the cells of small tests over one or two of them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import StrEnum
from itertools import combinations, pairwise, product

import numpy as np

from gpcorrect.discrepancy.recording.scene import Scene
from gpcorrect.discrepancy.settings import TESTS
from gpcorrect.sim.effects import lag, play
from gpcorrect.types import FloatArray, IntArray

BINS = {1: 8, 2: 5}  # of one variable, and of each of two
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
    unit: str = field(default="", compare=False)  # SI, empty for pure numbers

    def __str__(self) -> str:
        return str(self.quantity) if self.joint is None else f"{self.quantity} {self.joint}"


@dataclass(frozen=True, eq=False)
class Covariates:
    """Variables for one joint's channel, from the motor side only, so that no truth leaks into them."""

    values: dict[Variable, FloatArray]  # (n,) each; what does not vary is left out
    primary: tuple[Variable, ...]  # tested together with every other
    # (n,) each: what plays of a few half widths and lags of a few time constants leave of the motors' path and load.
    # What has a memory, of whatever kind, is a function of such states (Preisach's operator is an integral over plays).
    memory: tuple[FloatArray, ...] = ()


def travel_direction(path: FloatArray, run: IntArray) -> FloatArray:
    """Return the direction `(n,)` of the last move larger than the resolution, -1 or 1; 0 before the first one.

    Parameters
    ----------
    path : (n,) array, rad or m
    run : (n,) int array, continuous motion that each row belongs to
    """
    threshold = TESTS.resolution * float(np.ptp(path))
    direction = np.zeros(len(path))
    for k in np.unique(run):
        rows = np.flatnonzero(run == k)
        anchor, current = path[rows[0]], 0.0
        for row in rows:
            moved = path[row] - anchor
            if abs(moved) > threshold:
                current = float(np.sign(moved))
            if current * moved > 0:
                anchor = path[row]
            direction[row] = current
    return direction


def covariates_of(scene: Scene, joint_index: int | None, rows: IntArray) -> Covariates:
    """Return the variables of a channel.

    Parameters
    ----------
    scene : Scene
    joint_index : int or None, column of the channel's joint; None for a channel of all joints
    rows : (m,) int array, of the log, at which they are wanted
    """
    time, motor, run, load = scene.time, scene.motor_path(), scene.run_of_row(), scene.load()
    speed = scene.layout.gather(scene.motion.velocity)
    inside, step = run[1:] == run[:-1], np.diff(time)
    even = np.where(inside & (step > 0), step, np.inf)  # no acceleration from one run to the next
    values: dict[Variable, FloatArray] = {}
    memory: list[FloatArray] = []
    columns = range(len(scene.joints)) if joint_index is None else [joint_index]
    for j in columns:
        joint = scene.joints[j]
        direction = travel_direction(motor[:, j], run)
        turned = np.r_[True, (np.diff(direction) != 0) | ~inside]
        last = np.maximum.accumulate(np.where(turned, np.arange(len(time)), 0))  # reversal, or start of the run
        values |= {
            Variable(Quantity.POSITION, joint): motor[:, j],
            Variable(Quantity.DIRECTION, joint): direction,
            Variable(Quantity.SPEED, joint): np.abs(speed[:, j]),
            Variable(Quantity.TIME_SINCE_REVERSAL, joint): time - time[last],
            Variable(Quantity.WAY_SINCE_REVERSAL, joint): direction * np.abs(motor[:, j] - motor[last, j]),
            Variable(Quantity.ACCELERATION, joint): np.r_[0.0, np.diff(speed[:, j]) / even],
            Variable(Quantity.LOAD, joint): load[:, j],
        }
        if scene.effort is not None:
            values[Variable(Quantity.EFFORT, joint)] = scene.effort[:, j]
        memory += _memories(scene, motor[:, j], load[:, j])
    primary = [v for v in values if v.quantity in (Quantity.POSITION, Quantity.DIRECTION)]
    for k, joint in enumerate(scene.joints):
        if k not in columns:
            values[Variable(Quantity.POSITION, joint)] = motor[:, k]
            values[Variable(Quantity.DIRECTION, joint)] = travel_direction(motor[:, k], run)
    first = np.r_[True, np.diff(scene.trajectory) != 0]
    start = np.maximum.accumulate(np.where(first, np.arange(len(time)), 0))
    values[Variable(Quantity.TIME_IN_TRAJECTORY)] = time - time[start]
    values[Variable(Quantity.SESSION_TIME)] = scene.layout.gather(scene.motion.time)
    if scene.n_sessions > 1:
        values[Variable(Quantity.SESSION)] = scene.session.astype(np.float64)
    varying = {replace(v, unit=_unit(v, scene)): x[rows] for v, x in values.items() if np.std(x[rows]) > 0}
    return Covariates(
        varying,
        tuple(v for v in primary if v in varying),
        tuple(m[rows] for m in memory if np.std(m[rows]) > 0),
    )


def _memories(scene: Scene, motor: FloatArray, load: FloatArray) -> list[FloatArray]:
    """States of plays and lags of a joint's motor path and load, at the log's rows `(n,)`."""
    motion, span = scene.motion, float(np.ptp(motor))
    path, carried = scene.layout.spread(motor), scene.layout.spread(load)
    states = [path - play(path, radius * span) for radius in PLAYS]
    states += [x - lag(x, motion.time, seconds, motion.session) for x in (path, carried) for seconds in LAGS]
    return [scene.layout.gather(state) for state in states]


def _unit(variable: Variable, scene: Scene) -> str:
    """SI unit of a variable, that of its joint; empty for a pure number."""
    slides = variable.joint is not None and scene.machine.body.types[scene.joints.index(variable.joint)] == "P"
    length, force = ("m", "N") if slides else ("rad", "N m")
    units = {
        Quantity.POSITION: length,
        Quantity.WAY_SINCE_REVERSAL: length,
        Quantity.SPEED: f"{length}/s",
        Quantity.ACCELERATION: f"{length}/s^2",
        Quantity.LOAD: force,
        Quantity.EFFORT: force,
        Quantity.TIME_IN_TRAJECTORY: "s",
        Quantity.SESSION_TIME: "s",
        Quantity.TIME_SINCE_REVERSAL: "s",
    }
    return units.get(variable.quantity, "")


@dataclass(frozen=True)
class Span:
    """Where a cell lies along one variable: from `low` to `high`, which are the same for one of few values."""

    variable: Variable
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of one test over one or two variables: the cell `(n,)` of each row, and where each cell lies along them."""

    variables: tuple[Variable, ...]
    code: IntArray
    spans: tuple[tuple[Span, ...], ...]


def all_cells(covariates: Covariates) -> list[Cells]:
    """Return tests of every variable alone, and of the channel's own position and direction with every other one.

    Of too many, as of a tracker that sees six joints, those of one joint come first.

    Parameters
    ----------
    covariates : Covariates
    """
    values, primary = covariates.values, covariates.primary
    pairs = [(a, b) for a, b in combinations(values, 2) if a in primary or b in primary]
    pairs.sort(key=lambda pair: pair[0].joint != pair[1].joint)
    found = []
    for variables in [*((v,) for v in values), *pairs][: TESTS.max_tests]:
        code, spans = np.zeros(1, dtype=np.int64), []
        for variable in variables:
            own, ends = _cut(values[variable], BINS[len(variables)])
            code = code * len(ends) + own
            spans.append([Span(variable, low, high) for low, high in ends])
        found.append(Cells(variables, code, tuple(product(*spans))))
    return found


def _cut(values: FloatArray, n_bins: int) -> tuple[IntArray, list[tuple[float, float]]]:
    """Cut a variable so that all cells hold equally many rows; one of few values keeps them."""
    distinct = np.unique(values)
    if len(distinct) <= n_bins:
        return np.searchsorted(distinct, values).astype(np.int64), [(float(v), float(v)) for v in distinct]
    edges = np.unique(np.quantile(values, np.linspace(0, 1, n_bins + 1)))
    code = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    return code.astype(np.int64), [(float(a), float(b)) for a, b in pairwise(edges)]
