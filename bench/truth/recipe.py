"""How a cause gets its size and a recording its noise: the recipe of a case, whichever simulator moves the machine."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from truth.alike import side_of
from truth.hidden import Growth, Hidden
from truth.history import Readings
from truth.kinds.kind import Cause
from truth.noise import NoiseLaw
from truth.reference import Reference
from truth.spec import Case

Array = NDArray[np.float64]

DRAFT_STRIDE = 5  # every so many trajectories are simulated while a cause in the loop is sized


@dataclass(frozen=True, eq=False)
class Setting(ABC):
    """A case before anything is hidden in it: a machine that ran along a reference, and what its sensors read."""

    spec: Any
    machine: Any
    reference: Reference
    readings: Readings
    joint_noise: NoiseLaw
    tracker_noise: NoiseLaw
    registered: bool

    @property
    @abstractmethod
    def moved(self) -> tuple[Array, Array]:
        """Reported joints and commanded torques `(n, k)` at the ticks."""

    @abstractmethod
    def along(self, reference: Reference) -> Self:
        """Return the same machine, run along another reference."""

    @abstractmethod
    def run(self, hidden: Sequence[Hidden]) -> Readings:
        """Return what sensors read of the machine with its causes, run anew where they act on the motion."""

    @abstractmethod
    def read(self, hidden: Sequence[Hidden]) -> Readings:
        """Return what sensors read of the motion as it was, causes behind it: cheap."""

    @abstractmethod
    def ratio(self, hidden: Hidden, with_it: Readings, without: Readings, rows: NDArray[np.int64]) -> float:
        """Ratio of one cause between two runs, at logged ticks: RMS of its trace over RMS of the noise."""

    def with_noise(self, factor: float) -> Self:
        """Return the same with another level of noise."""
        return replace(self, joint_noise=self.joint_noise.times(factor), tracker_noise=self.tracker_noise.times(factor))


@dataclass(frozen=True, eq=False)
class Truth:
    """A case, its machine and motion without the causes (`setting`), and what was true with them at every tick."""

    case: Case
    setting: Setting
    readings: Readings
    hidden: tuple[Hidden, ...] = ()


def sized(
    setting: Setting, hidden: Hidden, cause: Cause, growth: Growth, start: float = 1.0, *, in_loop: bool
) -> tuple[Hidden, float]:
    """Return the cause at about the asked ratio, and its ratio: on the whole run where that is cheap, else on a part.

    Parameters
    ----------
    setting, hidden, cause : what runs, the cause before it is sized, and its sort
    growth, start : how it is made larger or smaller, and by which factor at first
    in_loop : bool, whether the machine has to run anew for every size
    """
    part = setting.along(_draft(setting, hidden, peaks=cause.peaks)) if in_loop else setting
    rows = part.reference.logged
    share = len(rows) / len(setting.reference.logged) if cause.peaks else 1.0

    def measure(trial: Hidden) -> float:
        with_it = part.run([trial]) if in_loop else part.read([trial])
        return setting.ratio(trial, with_it, part.readings, rows) * float(np.sqrt(share))

    return growth.grown(cause, hidden, setting.spec.ratio, measure, start=start)


def _draft(setting: Setting, hidden: Hidden, *, peaks: bool) -> Reference:
    """Return a few trajectories: the most extreme ones for a cause that acts at peaks, else spread evenly.

    Zig-zags only follow on from each other, so of them it is the first ones.
    """
    number, reference = setting.spec.trajectories, setting.reference
    if getattr(setting.spec, "motion", "") == "zigzag":
        return reference.only(np.arange(max(2, number // DRAFT_STRIDE)))
    if not peaks:
        return reference.only(np.arange(0, number, DRAFT_STRIDE if number > 2 * DRAFT_STRIDE else 2))
    reported, command = setting.moved
    peak = side_of(hidden.params) * reported if "end" in hidden.params else np.abs(command)
    greatest = [peak[reference.trajectory == k, hidden.column].max() for k in range(number)]
    return reference.only(np.sort(np.argsort(greatest)[-max(2, number // DRAFT_STRIDE) :]))


def hide(setting: Setting, hidden: Sequence[Hidden], most: float = np.inf) -> tuple[Setting, Readings, list[float]]:
    """Run the machine with its causes and set the noise so that the ratios hold (on geometric average, of several).

    Noise changes by the factor `most` at most; a cause that physics keeps smaller or larger has the ratio that it has.
    Among others, each is run once more by itself for its own ratio.
    """
    if not hidden:
        return setting, setting.readings, []
    readings, rows = setting.run(hidden), setting.reference.logged
    alone = [readings] if len(hidden) == 1 else [setting.run([h]) for h in hidden]
    ratios = [setting.ratio(h, own, setting.readings, rows) for h, own in zip(hidden, alone, strict=True)]
    wanted = float(np.exp(np.mean(np.log(np.maximum(ratios, 1e-6) / setting.spec.ratio))))
    factor = float(np.clip(wanted, 1.0 / most, most))
    return setting.with_noise(factor), readings, [r / factor for r in ratios]
