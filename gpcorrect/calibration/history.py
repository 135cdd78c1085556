"""What a model says of its making: each step, with what it learned from and how it did on what was held out."""

from __future__ import annotations

import platform
import shlex
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from gpcorrect.types import CalibrationLog

PACKAGES = ("gpcorrect", "numpy", "scipy", "scikit-learn", "numba")  # whose versions can change a model's numbers


@dataclass(frozen=True)
class PartErrors:
    """Errors of one method on what is quoted together, such as the position: statistics of their size, in `unit`."""

    method: str
    part: str
    unit: str
    mean: float
    sd: float
    rmse: float
    p95: float
    max: float


@dataclass(frozen=True)
class HeldOut:
    """A model measured on what was held out of its recordings, on the samples that pass cleaning.

    Parameters
    ----------
    samples, trajectories : int, how many were measured on
    errors : tuple of PartErrors, A row for each method and part, the corrected method's last
    coverage95 : float, fraction of the errors inside their 95 % intervals
    in_domain : float, fraction of the samples inside the training region
    """

    samples: int
    trajectories: int
    errors: tuple[PartErrors, ...]
    coverage95: float
    in_domain: float

    @property
    def corrected(self) -> tuple[PartErrors, ...]:
        """Errors of the model itself, a row a part."""
        return tuple(row for row in self.errors if row.method == self.errors[-1].method)


@dataclass(frozen=True)
class Step:
    """One step in the making of a model.

    Parameters
    ----------
    what : str, "fit", "update" or "rezero"
    date : str, UTC, ISO 8601, to the second
    command : str, command line of the process, as a shell would take it
    versions : mapping, of the packages that can change numbers, and of Python, by name
    source, sha256 : str, name of the data, and the SHA-256 of their files (empty for data that came from no file)
    held_out : HeldOut or None, errors on what was held out; None where nothing was
    """

    what: str
    date: str
    command: str
    versions: Mapping[str, str]
    source: str
    sha256: str
    held_out: HeldOut | None = None


def step_now(what: str, log: CalibrationLog) -> Step:
    """Return the step that this process takes now.

    Parameters
    ----------
    what : str, "fit", "update" or "rezero"
    log : CalibrationLog, what it learns from
    """
    return Step(what, now(), command_line(), versions(), log.name, log.digest)


def now() -> str:
    """Return the time of day: UTC, ISO 8601, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def versions() -> dict[str, str]:
    """Return the versions, by name, of Python and of the packages that can change a model's numbers."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:  # run from a source tree, or without an extra
            continue
    return found


def last_measured(history: tuple[Step, ...]) -> HeldOut | None:
    """Return the held-out errors of the last step that measured any.

    Parameters
    ----------
    history : tuple of Step, oldest first
    """
    return next((step.held_out for step in reversed(history) if step.held_out is not None), None)


def command_line() -> str:
    """Return the command line of this process, as a shell would take it."""
    program = Path(sys.argv[0])
    name = program.parent.name if program.name == "__main__.py" else program.name
    return shlex.join([name, *sys.argv[1:]])
