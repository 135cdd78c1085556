"""What a regression must offer to be measured beside the others."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from gpcorrect.types import FloatArray


class Peer(Protocol):
    """A fitted regression of m outputs."""

    def predict(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return means and standard deviations `(n, m)` of new observations at inputs `(n, d)`."""


class Standard:
    """Centre and spread of outputs `(n, m)`: every library is given outputs of unit spread."""

    def __init__(self, Y: FloatArray) -> None:
        self.centre, self.spread = Y.mean(axis=0), Y.std(axis=0)

    def scaled(self, Y: FloatArray) -> FloatArray:
        """Return outputs of unit spread."""
        return (Y - self.centre) / self.spread

    def restored(self, mean: FloatArray, std: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return means and deviations in the outputs' own units."""
        return mean * self.spread + self.centre, std * self.spread


Fit = Callable[[FloatArray, FloatArray, float], tuple[Peer, str]]
"""From inputs, outputs and a limit (s of processor time) to a fitted peer and what there is to say of it."""


def subset(X: FloatArray, size: int) -> FloatArray:
    """Pick rows at random, the same for every library."""
    return np.random.default_rng(0).choice(len(X), min(size, len(X)), replace=False)
