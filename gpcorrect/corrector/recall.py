"""What a corrector learned with memory features beside what it learned without: for paths and streams."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from gpcorrect.corrector.bounds import Bounds
from gpcorrect.corrector.memory import MemoryMap
from gpcorrect.gpr import IntervalCalibration, Predictor, Statistics
from gpcorrect.types import FloatArray

__all__ = ["Recall", "statistics_arrays", "statistics_from"]

MAP, PREDICTOR, STATISTICS = "map.", "predictor.", "statistics."


@dataclass(frozen=True, eq=False)
class Recall:
    """A second learned residual, whose inputs end in memory features; parts as in `CommandCorrector`.

    Parameters
    ----------
    memory : MemoryMap
        From a path of reference poses to its memory features.
    predictor : Predictor
    intervals : IntervalCalibration
    bounds : Bounds
    statistics : tuple of Statistics
    """

    memory: MemoryMap
    predictor: Predictor
    intervals: IntervalCalibration
    bounds: Bounds
    statistics: tuple[Statistics, ...]

    def to_parts(self) -> tuple[dict[str, Any], dict[str, FloatArray]]:
        """Return JSON-able data and arrays."""
        data, arrays = self.memory.to_parts()
        header = {"memory": data, "intervals": self.intervals.to_dict(), "bounds": self.bounds.to_dict()}
        named = {MAP + name: array for name, array in arrays.items()}
        named |= {PREDICTOR + name: array for name, array in self.predictor.to_arrays().items()}
        return header, {**named, **statistics_arrays(self.statistics)}

    @classmethod
    def from_parts(cls, data: Mapping[str, Any], arrays: Mapping[str, FloatArray]) -> Self:
        """Rebuild from :meth:`to_parts`."""
        return cls(
            memory=MemoryMap.from_parts(data["memory"], _below(arrays, MAP)),
            predictor=Predictor.from_arrays(_below(arrays, PREDICTOR)),
            intervals=IntervalCalibration.from_dict(data["intervals"]),
            bounds=Bounds.from_dict(data["bounds"]),
            statistics=statistics_from(arrays),
        )


def statistics_arrays(statistics: tuple[Statistics, ...]) -> dict[str, FloatArray]:
    """Return what predictors rest on as named arrays."""
    return {
        f"{STATISTICS}{i}.{name}": array
        for i, part in enumerate(statistics)
        for name, array in part.to_arrays().items()
    }


def statistics_from(arrays: Mapping[str, FloatArray]) -> tuple[Statistics, ...]:
    """Rebuild from :func:`statistics_arrays`; a model file written before there were any has none."""
    own = _below(arrays, STATISTICS)
    count = len({name.split(".")[0] for name in own})
    return tuple(Statistics.from_arrays(_below(own, f"{i}.")) for i in range(count))


def _below(arrays: Mapping[str, FloatArray], prefix: str) -> dict[str, FloatArray]:
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
