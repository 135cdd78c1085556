"""Where a motion's beginning still counts: what was before it is in no log, and an effect with memory depends on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpcorrect.discrepancy.recording.dataset import Dataset
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.settings import TESTS
from gpcorrect.sim.effects import Effect
from gpcorrect.types import BoolArray

MOST = 0.5  # of a joint's usual way: what remembers more depends on the beginning all along, as the fit has taken it


def open_beginnings(dataset: Dataset, effects: Sequence[Effect], noises: Sequence[ChannelNoise]) -> BoolArray:
    """Return samples `(n, c)` that may be off by an effect only because nobody knows how the motion began.

    A play stands anywhere in its gap, and friction holds a joint where it came to rest, until the joint has moved far
    enough. The model begins in the middle. A channel counts where the effect changes it by more than matters.

    Parameters
    ----------
    dataset : Dataset
    effects : sequence of Effect
        Those that are named.
    noises : sequence of ChannelNoise
        Of every channel.
    """
    scene = dataset.scene
    left_open = np.zeros(dataset.good.shape, dtype=np.bool_)
    way, run, nominal = scene.way(), scene.run_of_row(), dataset.predict()
    least = TESTS.resolution * np.ptp(scene.motor_path(), axis=0)
    usual = np.median([np.nan_to_num(way[run == k]).max(axis=0) for k in np.unique(run)], axis=0)
    for effect in effects:
        if not (needed := effect.forgets_after()):
            continue
        change = np.sqrt(np.mean((dataset.predict([effect]) - nominal) ** 2, axis=0))
        shows = change > TESTS.equivalence * np.array([n.std for n in noises])
        columns = [effect.column(scene.joints, joint) for joint in needed]
        enough = np.maximum(np.minimum(list(needed.values()), MOST * usual[columns]), least[columns])
        moved = (way[:, columns] > enough).all(axis=1)
        left_open |= ~moved[:, None] & shows
    return left_open
