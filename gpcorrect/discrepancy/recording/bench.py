"""The rows that evidence is taken from: a scene split into parts, condensed to means over a few samples."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from gpcorrect.discrepancy.recording.counts import counts_of
from gpcorrect.discrepancy.recording.noise import outliers
from gpcorrect.discrepancy.recording.scene import Scene, Signal
from gpcorrect.discrepancy.recording.split import Parts, Split
from gpcorrect.sim.effects import Effect
from gpcorrect.types import BoolArray, FloatArray, IntArray

__all__ = ["Bench", "build_bench"]

REMEMBERED_BYTES = 150_000_000
REMEMBERED_SETS = 20_000
STILL = 1e-4  # of a joint's travel between samples: slower is standing still


@dataclass(frozen=True, eq=False)
class Bench(Parts):
    """Condensed rows: each the mean over consecutive samples of one block.

    Parameters
    ----------
    scene : Scene
        The recording and its simulator.
    group : (n,) int array
        Condensed row that each log row goes into, -1 for none.
    good : (n, c) bool array
        Measured samples that are no outliers.
    time : (m,) array
        Of the condensed rows, s.
    block, part : (m,) int arrays
        Their block, from 0 without gaps, and part (0 discovery, 1 confirmation, 2 sealed).
    still : (m,) bool array
        Whether nothing moved.
    """

    scene: Scene
    group: IntArray
    good: BoolArray
    time: FloatArray
    block: IntArray
    part: IntArray
    still: BoolArray
    _known: dict[tuple[Effect, ...], list[Hashable]] = field(default_factory=dict, repr=False)
    _columns: dict[Hashable, FloatArray] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return len(self.time)

    def means(self, values: FloatArray) -> FloatArray:
        """Means `(m, ...)` of log rows' values `(n, ...)`."""
        used, index, count = self._grouping
        flat = values[used].reshape(len(index), -1)
        sums = np.stack([np.bincount(index, weights=column, minlength=len(self)) for column in flat.T], axis=1)
        result: FloatArray = (sums / count[:, None]).reshape(len(self), *values.shape[1:])
        return result

    @cached_property
    def _grouping(self) -> tuple[IntArray, IntArray, IntArray]:
        """Log rows that are used, the condensed row of each, and how many go into one."""
        used = np.flatnonzero(self.group >= 0)
        return used, self.group[used], np.bincount(self.group[used], minlength=len(self))

    def residual(self, effects: Sequence[Effect] = ()) -> FloatArray:
        """Mean of measured minus simulated `(m, c)` over the good samples; NaN where a channel has none."""
        error = self.scene.residual(effects)
        count, sums = self.means(self.good.astype(np.float64)), self.means(np.where(self.good, error, 0.0))
        known = count > 0
        return np.where(known, sums / np.where(known, count, 1.0), np.nan)

    def predict(self, effects: Sequence[Effect] = ()) -> FloatArray:
        """Mean simulated channels `(m, c)`; the last ones asked for are remembered, each by what it depends on."""
        key = tuple(effects)
        if key not in self._known:
            _make_room(self._known, REMEMBERED_SETS)
            self._known[key] = [signal.key for signal in self._remembered(effects)]
        if any(k not in self._columns for k in self._known[key]):
            self._remembered(effects)
        return np.stack([self._columns[k] for k in self._known[key]], axis=1)

    def _remembered(self, effects: Sequence[Effect]) -> list[Signal]:
        """Signals of a set, their means in memory."""
        signals = self.scene.signals(effects)
        _make_room(self._columns, REMEMBERED_BYTES // (8 * len(self)))
        for signal in signals:
            if signal.key not in self._columns:
                self._columns[signal.key] = self.means(signal.rows())
        return signals

    def strict(self) -> Bench:
        """Return the bench with all of the residual in account, for what is reported of it."""
        if self.scene.slack is None:
            return self
        return replace(self, scene=self.scene.strict(), _known={}, _columns={})

    @cached_property
    def resolution(self) -> FloatArray:
        """Step `(c,)` in which each channel is written down; 0 where it is too fine to be seen."""
        counts = [counts_of(column) for column in self.scene.observed.T]
        return np.array([c.step if c is not None else 0.0 for c in counts])

    @property
    def seen(self) -> BoolArray:
        """(m,) rows of discovery and confirmation."""
        return np.asarray(self.part != 2)


def _make_room(memory: dict[Any, Any], most: int) -> None:
    while len(memory) > most:
        memory.pop(next(iter(memory)))


def build_bench(scene: Scene, split: Split, max_rows: int = 9000) -> Bench:
    """Condense a scene to about `max_rows` rows.

    Parameters
    ----------
    scene : Scene
        Recording and simulator.
    split : Split
        Blocks and parts of its rows.
    max_rows : int
        Above, means over as many samples as it takes are used; noise is estimated on the means.
    """
    used = split.block >= 0
    stride = max(1, int(np.ceil(used.sum() / max_rows)))
    group = np.full(len(scene), -1)
    count = 0
    for k in np.unique(split.block[used]):
        rows = np.flatnonzero(split.block == k)
        group[rows] = count + np.arange(len(rows)) // stride
        count = int(group[rows[-1]]) + 1
    first = np.flatnonzero(np.r_[True, np.diff(group[used]) != 0])
    rows = np.flatnonzero(used)[first]
    error = scene.residual()
    spikes = np.stack([outliers(column, split.block) for column in error.T], axis=1)
    moved = np.abs(np.diff(scene.motor_path(), axis=0, prepend=np.nan))
    still = (moved < STILL * np.ptp(scene.motor_path(), axis=0)).all(axis=1).astype(np.float64)
    bench = Bench(
        scene=scene,
        group=group,
        good=np.isfinite(error) & ~spikes,
        time=np.zeros(count),
        block=np.unique(split.block[rows], return_inverse=True)[1].astype(np.int64),
        part=split.part[rows],
        still=np.zeros(count, dtype=np.bool_),
    )
    return Bench(scene, group, bench.good, bench.means(scene.time), bench.block, bench.part, bench.means(still) == 1.0)
