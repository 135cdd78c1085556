"""The hot path: all outputs for one input, group by group of outputs that share a kernel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from gpcorrect.gpr.compiled import Tables, predict_one, tables
from gpcorrect.gpr.shared_predictor import SharedPredictor
from gpcorrect.types import FloatArray

__all__ = ["Predictor"]


@dataclass(frozen=True, eq=False)
class Predictor:
    """Predictions of all outputs; it changes nothing, so threads may share it.

    Parameters
    ----------
    parts : tuple of SharedPredictor
        One for each group of outputs, in the order of the outputs.

    Attributes
    ----------
    tables : Tables
        The same as a single query reads it.
    """

    parts: tuple[SharedPredictor, ...]
    tables: Tables = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "tables", tables(self.parts))
        self.mean_std(self.parts[0].basis[0])  # compiled here (or read from numba's cache), never in the first query

    @property
    def signal(self) -> FloatArray:
        """Prior variance `(m,)` of every output."""
        return np.concatenate([part.signal for part in self.parts])

    @property
    def noise(self) -> FloatArray:
        """Noise variance `(m,)` of every output."""
        return np.concatenate([part.noise for part in self.parts])

    def mean_std(self, x: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """Predict one input.

        Parameters
        ----------
        x : (d,) array

        Returns
        -------
        mean : (m,) array
        std : (m,) array
            Standard deviation of a new observation: latent variance and noise.
        novelty : float
            Share of the prior variance that is left, of the group told least of: 0 amid data, 1 far from all.
        """
        # A copy: another layout or a read-only array would be compiled for anew.
        answer: tuple[FloatArray, FloatArray, float] = predict_one(np.array(x, dtype=np.float64), self.tables)
        return answer

    def mean_std_batch(self, X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Predict inputs `(n, d)`: means `(n, m)`, standard deviations `(n, m)` and novelties `(n,)`."""
        means, stds, novelties = zip(*[part.mean_std_batch(X) for part in self.parts], strict=True)
        return np.concatenate(means, axis=1), np.concatenate(stds, axis=1), np.max(novelties, axis=0)

    def to_arrays(self) -> dict[str, FloatArray]:
        """Return the arrays by name, for a model file."""
        return {f"{i}.{name}": array for i, part in enumerate(self.parts) for name, array in part.to_arrays().items()}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, FloatArray]) -> Self:
        """Rebuild a predictor from :meth:`to_arrays`.

        Raises
        ------
        KeyError
            An array is missing.
        """
        count = len({name.split(".")[0] for name in arrays})
        if count == 0:
            raise KeyError("a predictor has at least one group of arrays")
        return cls(tuple(SharedPredictor.from_arrays(_part(arrays, i)) for i in range(count)))


def _part(arrays: Mapping[str, FloatArray], index: int) -> dict[str, FloatArray]:
    prefix = f"{index}."
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
