"""What checks share: the log with what is derived from it, and what a check is and yields."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from gpcorrect.arms import RemoteCentreArm, arm_named
from gpcorrect.errors import DataError
from gpcorrect.logs.sync import REFERENCES, TimeOffset, log_offset
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal

Severity = Literal["error", "warning", "info"]

JOINT_POSITIONS = ("setpoint_jp", "measured_jp", "external_jp")
EXAMPLES = 5  # rows named in a finding
MIN_CORRELATION = 0.8  # of ranks: two signals of one joint agree at least so well, whatever their units
MIN_PAIRED = 20  # samples, below which two signals are not compared; chosen by hand
CLEARER = 0.7  # of what the best rotation leaves: 56 simulated and real logs that are right leave 0.95 and more
MAX_LEFT = 0.5  # of the spread, that a reflection may leave: of what is unrelated it leaves all
ROBUST_STEPS = 30  # of reweighting
EXACT = 1e-12  # of the largest number, below which all weigh alike
FLAT = 0.3  # of the median distance, below which all weigh alike


@dataclass(frozen=True)
class Finding:
    """One thing that a check has to say.

    Parameters
    ----------
    severity : {"error", "warning", "info"}
        error: what is learned from this log will be wrong; warning: look at it first; info: good to know.
    code : str, short fixed name, for programs
    signal : str, name of the log's signal, "time" or "trajectory"; empty when it is about the log as a whole
    message : str, what was found, with numbers and units
    hint : str, what to do about it
    count : int, samples (or trajectories) it is about
    rows : sequence of int
        Those samples: rows of the log counted from 0, or trajectory numbers when the signal is "trajectory". The
        first few stay.
    """

    severity: Severity
    code: str
    signal: str
    message: str
    hint: str = ""
    count: int = 0
    rows: Sequence[int] | IntArray = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "rows", tuple(int(r) for r in self.rows[:EXAMPLES]))

    def to_dict(self) -> dict[str, Any]:
        """JSON-able form."""
        return asdict(self) | {"rows": list(self.rows)}


class Evidence:
    """A log and what several checks derive from it, computed once.

    Parameters
    ----------
    log : CalibrationLog, any; nothing about it is taken for granted
    compared : collection of str, optional, signals whose motion is compared with the robot's; all by default
    """

    def __init__(self, log: CalibrationLog, compared: Collection[str] | None = None) -> None:
        self.log = log
        self.compared = compared

    @cached_property
    def arm(self) -> RemoteCentreArm | None:
        """The arm that robot and arm of the meta data name, together or one of them; None when neither is known."""
        meta = self.log.meta
        words = set(re.findall(r"[a-z]+", f"{meta.robot} {meta.arm}".lower()))
        side = words & {"left", "right"}
        if "raven" in words and len(side) == 1:
            return arm_named(f"raven2_{side.pop()}")
        if "psm" in words and "si" not in words:  # the Si arm has other links than the classic one
            return arm_named("dvrk_psm")
        for name in (meta.arm, meta.robot):
            with suppress(DataError):
                return arm_named(name)
        return None

    @cached_property
    def joint_types(self) -> str:
        """Joint kinds by the meta data, else by the arm; empty when neither says."""
        return self.log.meta.joint_types or (self.arm.joint_types if self.arm else "")

    @cached_property
    def offsets(self) -> tuple[TimeOffset, ...]:
        """Time offset of every observed signal against the best reference there is for it; none without a clock."""
        found: list[TimeOffset] = []
        for observed, references in () if self.log.static else REFERENCES.items():
            reference = next((r for r in references if {observed, r} <= self.present), None)
            if reference is not None and (self.compared is None or observed in self.compared):
                found.append(log_offset(self.log, observed, reference))
        return tuple(found)

    @cached_property
    def previous(self) -> IntArray:
        """(n,) row before each in the same trajectory; -1 for the first row of a trajectory."""
        before = np.full(len(self.log), -1)
        for _, rows in self.log.trajectories():
            before[rows[1:]] = rows[:-1]
        return before

    @cached_property
    def steps(self) -> FloatArray:
        """(n,) time since the row before, s; NaN for the first row of a trajectory."""
        return np.where(self.previous < 0, np.nan, self.log.time - self.log.time[self.previous])

    @cached_property
    def typical_step(self) -> float:
        """Median step forward, s; infinite when there is none."""
        forward = self.steps[self.steps > 0]
        return float(np.median(forward)) if forward.size else np.inf

    @cached_property
    def present(self) -> set[str]:
        """Signals that have at least one sample."""
        return {name for name, known in self.known.items() if known.any()}

    @cached_property
    def tables(self) -> dict[str, FloatArray]:
        """Each signal as an array `(n, k)`: positions and quaternions side by side, or joints."""
        found: dict[str, FloatArray] = {}
        for name in self.log.signals:
            value = getattr(self.log, name)
            found[name] = value.table if isinstance(value, PoseSignal) else value.reshape(len(value), -1)
        return found

    @cached_property
    def known(self) -> dict[str, BoolArray]:
        """(n,) mask of rows in which every number of a signal is present."""
        return {name: np.asarray(np.isfinite(table).all(axis=1)) for name, table in self.tables.items()}

    @cached_property
    def positions(self) -> dict[str, FloatArray]:
        """Positions `(n, 3)` of each pose signal."""
        return {name: self.tables[name][:, :3] for name in self.log.POSES if name in self.tables}

    @cached_property
    def quaternions(self) -> dict[str, FloatArray]:
        """Quaternions `(n, 4)` of the pose signals that have any."""
        return {name: self.tables[name][:, 3:] for name in self.positions if self.tables[name].shape[1] == 7}

    def speed(self, positions: FloatArray) -> FloatArray:
        """Speed `(n,)` since the row before in the same trajectory; NaN where time does not advance.

        Parameters
        ----------
        positions : (n, k) array, m or rad
        """
        lengths: FloatArray = np.linalg.norm(positions - positions[self.previous], axis=1)
        return lengths / np.where(self.steps > 0, self.steps, np.nan)

    def repeats(self, name: str) -> BoolArray:
        """(n,) mask of rows that equal the row before in the same trajectory to the last bit.

        Parameters
        ----------
        name : str
        """
        table = self.tables[name]
        return np.asarray((self.previous >= 0) & (table == table[self.previous]).all(axis=1))


Check = Callable[[Evidence], Iterator[Finding]]
"""One question to a log: it yields what there is to say, nothing when all is well."""

CHECKS: dict[str, Check] = {}
"""All checks by name, in the order in which they are asked."""


def check(ask: Check) -> Check:
    """Enter a check into the registry, under its name without the underscore.

    Parameters
    ----------
    ask : Check, a new check is a function with this decorator, in a module that the package imports
    """
    CHECKS[ask.__name__.lstrip("_")] = ask
    return ask


def extent(positions: FloatArray) -> float:
    """Diagonal of the box around positions, 1st to 99th percentile, m; 0 without samples.

    Parameters
    ----------
    positions : (n, 3) array, m; NaN where missing
    """
    known = positions[np.isfinite(positions).all(axis=1)]
    if not len(known):
        return 0.0
    low, high = np.percentile(known, [1, 99], axis=0)
    return float(np.linalg.norm(high - low))


def spread(values: FloatArray) -> float:
    """Median distance of rows from their median; 0 without samples.

    Parameters
    ----------
    values : (n, k) array, NaN where missing
    """
    known = values[np.isfinite(values).all(axis=1)]
    if not len(known):
        return 0.0
    return float(np.median(np.linalg.norm(known - np.median(known, axis=0), axis=1)))


def spread_ratio(values: FloatArray, reference: FloatArray) -> float:
    """How many times wider values vary than a reference that they follow; NaN if they do not.

    Parameters
    ----------
    values, reference : (n,) arrays, NaN where missing
    """
    known = np.isfinite(values) & np.isfinite(reference)
    a, b = values[known], reference[known]
    if len(a) < MIN_PAIRED or np.ptp(a) == 0 or np.ptp(b) == 0:
        return float("nan")
    from scipy.stats import spearmanr  # half a second to import, and every recording that is read would pay it

    if abs(float(spearmanr(a, b).statistic)) < MIN_CORRELATION:
        return float("nan")
    wide_a, wide_b = (float(np.diff(np.percentile(x, [5, 95]))[0]) for x in (a, b))
    return wide_a / wide_b if wide_b > 0 else float("nan")


def runs(mask: BoolArray) -> IntArray:
    """Unbroken runs of True as `(r, 2)`: first row, and the row after the last.

    Parameters
    ----------
    mask : (n,) bool array, a row each
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return edges.reshape(-1, 2)


def rigid_misfit(points: FloatArray, target: FloatArray) -> float:
    """Median distance, m, left by the best rigid motion of points onto targets, faults aside; NaN for too few.

    Parameters
    ----------
    points, target : (n, 3) arrays, m; NaN where missing
    """
    known = np.isfinite(points).all(axis=1) & np.isfinite(target).all(axis=1)
    if known.sum() < MIN_PAIRED:
        return float("nan")
    return _misfit(points[known], target[known], 1.0, axial=False)


def mirrored(reference: FloatArray, observed: FloatArray, *, axial: bool = False) -> bool:
    """Whether a reflection takes points onto others clearly better than any rotation does; no where it is unclear.

    Both are fitted with weights that faults of the tracker hardly have (least absolute distances).

    Parameters
    ----------
    reference, observed : (n, k) arrays, NaN where missing
    axial : bool, whether a point and its negative are the same, as of unit quaternions; they are not centred then
    """
    known = np.isfinite(reference).all(axis=1) & np.isfinite(observed).all(axis=1)
    if known.sum() < MIN_PAIRED:
        return False
    x, y = reference[known], observed[known]
    if axial:
        x, y = _one_side(x), _one_side(y)
    else:  # about the median, in units of the spread
        x, y = ((v - np.median(v, axis=0)) / max(spread(v), np.finfo(float).tiny) for v in (x, y))
    rotated, reflected = (_misfit(x, y, sign, axial=axial) for sign in (1.0, -1.0))
    return reflected < CLEARER * rotated and reflected < MAX_LEFT * spread(y)


def _one_side(points: FloatArray) -> FloatArray:
    """Return points `(n, k)` of norm 1, all on one side of the origin."""
    unit: FloatArray = points / np.linalg.norm(points, axis=1, keepdims=True)
    side: FloatArray = unit @ np.linalg.svd(unit, full_matrices=False)[2][0]
    return unit * np.where(side < 0, -1.0, 1.0)[:, None]


def _misfit(x: FloatArray, y: FloatArray, sign: float, *, axial: bool) -> float:
    """Median distance that the best orthogonal map of this determinant leaves between points `(n, k)`; or NaN."""
    weight = np.ones(len(x))
    for _ in range(ROBUST_STEPS):
        total = weight.sum()
        a, b = (np.zeros(x.shape[1]) if axial else weight @ points / total for points in (x, y))
        products = (weight[:, None] * (y - b)).T @ (x - a)
        if not np.isfinite(products).all():  # numbers near the largest there are
            return float("nan")
        u, _, vt = np.linalg.svd(products)
        u[:, -1] *= sign * np.sign(np.linalg.det(u) * np.linalg.det(vt))
        fitted = (x - a) @ (u @ vt).T + b
        if axial:
            y = y * np.where(np.einsum("ij,ij->i", fitted, y) < 0, -1.0, 1.0)[:, None]
        distance = np.linalg.norm(y - fitted, axis=1)
        least = max(FLAT * float(np.median(distance)), EXACT * float(np.abs(y).max()))
        if least == 0.0:
            return 0.0
        weight = 1.0 / np.maximum(distance, least)
    return float(np.median(distance))
