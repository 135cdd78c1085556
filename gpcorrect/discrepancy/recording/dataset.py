"""The rows that evidence is taken from: a scene split into parts, condensed to means over a few samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from gpcorrect.discrepancy.recording.noise import ChannelNoise, outliers
from gpcorrect.discrepancy.recording.replay_memory import Remembered
from gpcorrect.discrepancy.recording.scene import Scene
from gpcorrect.discrepancy.recording.split import Split
from gpcorrect.discrepancy.recording.stated_noise import quantisation_of
from gpcorrect.sim.effects import Effect
from gpcorrect.types import BoolArray, FloatArray, IntArray

REMEMBERED_BYTES = 150_000_000  # of condensed channels, by sets of effects: memory only, no result depends on it
LEVER_ROWS, LEVER_STEP = 200, 1e-5  # rows that levers are taken from, and a small move, rad or m
STILL = 1e-4  # of a joint's travel between samples: slower is standing still


@dataclass(frozen=True, eq=False)
class Dataset:
    """Condensed rows: m means over consecutive samples of one block, of the log's n rows and c channels."""

    scene: Scene
    group: IntArray  # (n,) condensed row that each log row goes into, -1 for none
    good: BoolArray  # (n, c) measured samples that are no outliers
    time: FloatArray  # (m,) s
    block: IntArray  # (m,) from 0 without gaps
    part: IntArray  # (m,) 0 discovery, 1 confirmation, 2 test
    still: BoolArray  # (m,) whether nothing moved
    memory: Remembered[FloatArray] = field(default_factory=partial(Remembered, REMEMBERED_BYTES), repr=False)

    def __len__(self) -> int:
        return len(self.time)

    @property
    def discovery(self) -> BoolArray:
        """(m,) rows in which effects are looked for."""
        return np.asarray(self.part == 0)

    @property
    def confirmation(self) -> BoolArray:
        """(m,) rows on which what was found must hold again."""
        return np.asarray(self.part == 1)

    @property
    def training(self) -> BoolArray:
        """(m,) rows of discovery and confirmation."""
        return np.asarray(self.part != 2)

    @property
    def test(self) -> BoolArray:
        """(m,) rows that only the final figures see."""
        return np.asarray(self.part == 2)

    def means(self, values: FloatArray) -> FloatArray:
        """Return means `(m, ...)` over the samples of each condensed row.

        Parameters
        ----------
        values : (n, ...) array, of the log's rows
        """
        used, first, count = self._grouping
        sums = np.add.reduceat(values[used], first, axis=0)
        return np.asarray(sums / count.reshape(-1, *[1] * (values.ndim - 1)))

    @property
    def samples_a_row(self) -> int:
        """How many samples a condensed row is usually the mean of."""
        return int(np.median(self._grouping[2]))

    @cached_property
    def _grouping(self) -> tuple[IntArray, IntArray, IntArray]:
        """Log rows that are used, where among them each condensed row begins, and how many go into it."""
        used = np.flatnonzero(self.group >= 0)
        return used, np.flatnonzero(np.diff(self.group[used], prepend=-1)), np.bincount(self.group[used])

    def residual(self, effects: Sequence[Effect] = ()) -> FloatArray:
        """Return the mean of measured minus simulated `(m, c)` over the good samples; NaN where a channel has none.

        Parameters
        ----------
        effects : sequence of Effect
        """
        error = self.scene.residual(effects)
        count, sums = self.means(self.good.astype(np.float64)), self.means(np.where(self.good, error, 0.0))
        known = count > 0
        return np.where(known, sums / np.where(known, count, 1.0), np.nan)

    @cached_property
    def observed(self) -> FloatArray:
        """(m, c) measured channels; NaN where a channel has no good sample."""
        return self.residual() + self.predict()

    def predict(self, effects: Sequence[Effect] = (), near: Sequence[Effect] | None = None) -> FloatArray:
        """Return mean simulated channels `(m, c)`.

        Parameters
        ----------
        effects : sequence of Effect
        near : sequence of Effect, optional
            A set from which it differs by little: quicker, and the difference, from the set as seen near itself, is
            right to a few per cent, as :meth:`Scene.near` has it.
        """
        scene = self.scene if near is None else self.scene.near(near)
        key = scene.begun, tuple(effects)
        if (channels := self.memory.get(key)) is None:
            channels = self.memory.keep(key, self.means(scene.predict(effects)))
            channels.flags.writeable = False
        return channels

    def changes(self, effects: Sequence[Effect]) -> FloatArray:
        """Return the change of the channels `(m, c, k)` by each of k effects alone.

        Parameters
        ----------
        effects : sequence of Effect
        """
        nominal = self.predict()
        alone = [self.predict([effect]) - nominal for effect in effects]
        return np.stack(alone, axis=2) if alone else np.zeros((*nominal.shape, 0))

    def strict(self) -> Dataset:
        """Return the dataset with all of the residual in account, for what is reported of it."""
        if self.scene.slack is None:
            return self
        return replace(self, scene=self.scene.strict(), memory=Remembered(REMEMBERED_BYTES))

    def tolerated(self, noises: Sequence[ChannelNoise]) -> dict[str, float]:
        """Return what the tolerance of table and registration takes up of each channel, RMS over its noise.

        Empty where there is none.

        Parameters
        ----------
        noises : sequence of ChannelNoise
        """
        if self.scene.slack is None:
            return {}
        left_out = (self.strict().residual() - self.residual())[self.training]
        size = np.sqrt(np.nanmean(left_out**2, axis=0))
        return {c.name: float(s / n.std) for c, s, n in zip(self.scene.channels, size, noises, strict=True)}

    @cached_property
    def resolution(self) -> FloatArray:
        """Step `(c,)` in which each channel is written down; 0 where it is too fine to be seen."""
        found = map(quantisation_of, self.scene.observed.T)
        return np.array([0.0 if steps is None else steps.step for steps in found])

    @cached_property
    def levers(self) -> FloatArray:
        """(k,) root mean square of how far the tip moves for each unit of a joint, m; 0 where that is not known."""
        scene, body = self.scene, self.scene.machine.body
        if body.chain is None:
            return np.zeros(len(scene.joints))
        motor = scene.motor_path()[:: max(1, len(scene) // LEVER_ROWS)]
        steps = LEVER_STEP * np.eye(len(scene.joints))
        tip, *moved = (body.chain.forward(body.all_joints(motor + s))[:, :3, 3] for s in (0.0, *steps))
        return np.asarray(np.sqrt(np.mean(np.sum(np.square(moved - tip), axis=2), axis=1)) / LEVER_STEP)

    @cached_property
    def trajectory(self) -> IntArray:
        """(m,) trajectory of each condensed row, as the log numbers them."""
        used, first, _ = self._grouping
        return self.scene.trajectory[used[first]]


def build_dataset(scene: Scene, split: Split, max_rows: int) -> Dataset:
    """Condense a scene to about `max_rows` rows.

    Parameters
    ----------
    scene : Scene
    split : Split, blocks and parts of its rows
    max_rows : int, above, means over as many samples as it takes are used; noise is estimated on the means
    """
    used = split.block >= 0
    stride = max(1, int(np.ceil(used.sum() / max_rows)))
    group = np.full(len(scene), -1)
    count = 0
    for k in np.unique(split.block[used]):
        rows = np.flatnonzero(split.block == k)
        group[rows] = count + np.arange(len(rows)) // stride
        count = int(group[rows[-1]]) + 1
    first = np.flatnonzero(used)[np.r_[True, np.diff(group[used]) != 0]]
    error = scene.residual()
    spikes = np.stack([outliers(column, split.block) for column in error.T], axis=1)
    motor = scene.motor_path()
    still = (np.abs(np.diff(motor, axis=0, prepend=np.nan)) < STILL * np.ptp(motor, axis=0)).all(axis=1)
    return Dataset(
        scene=scene,
        group=group,
        good=np.isfinite(error) & ~spikes,
        time=np.bincount(group[used], scene.time[used]) / np.bincount(group[used]),
        block=np.unique(split.block[first], return_inverse=True)[1].astype(np.int64),
        part=split.part[first],
        still=np.bincount(group[used], ~still[used]) == 0.0,
    )
