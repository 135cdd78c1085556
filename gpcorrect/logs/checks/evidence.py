"""What checks share: the log with what is derived from it, and what a check is and yields."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
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

    def both(self, pairs: Iterable[tuple[str, str]]) -> Iterator[tuple[str, str]]:
        """Yield those pairs of signals of which both are present.

        Parameters
        ----------
        pairs : iterable of (str, str)
        """
        yield from (pair for pair in pairs if set(pair) <= self.present)


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
