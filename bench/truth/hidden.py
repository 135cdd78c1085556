"""A hidden cause and its size: what both truths say of one, however their machines move."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Params = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Hidden:
    """One hidden cause: its name, the column it acts on and its numbers."""

    name: str
    column: int
    params: Params


def scaled(law: Any, params: Params, factor: float) -> Params:
    """Return the parameters of a cause `factor` times as large, as far as the law of its sort lets it grow."""
    changed = dict(params)
    for names, by in ((law.grow, factor), (law.shrink, 1.0 / factor)):
        for name in names:
            times, value = by ** law.power.get(name, 1.0), params[name]
            changed[name] = [v * times for v in value] if isinstance(value, list) else value * times
    return changed


@dataclass(frozen=True)
class Growth:
    """Search for the factor at which a cause has the size asked for, inside what is physical.

    Parameters
    ----------
    close : float, relative error of the ratio at which the search ends; the noise's level takes up the rest
    tries : int, simulations at the most
    stride : float, longest step, in the logarithm of the factor
    physical : mapping, lowest and highest value of a cause's parameters
    """

    close: float
    tries: int
    stride: float
    physical: Mapping[str, Mapping[str, tuple[float, float]]]

    def clamped(self, hidden: Hidden) -> Hidden:
        """Return the cause with its numbers inside what is physical."""
        params = dict(hidden.params)
        for name, (low, high) in self.physical.get(hidden.name, {}).items():
            params[name] = float(np.clip(params[name], low, high))
        return replace(hidden, params=params)

    def grown(
        self, law: Any, hidden: Hidden, target: float, measure: Callable[[Hidden], float], start: float = 1.0
    ) -> tuple[Hidden, float]:
        """Return the cause scaled until its measured ratio is near the target, as physics lets it; and its ratio.

        Secant steps on logarithms of factor and ratio, from the factor `start`, halving where a step leaves the
        bracket.
        """
        x, low, high = float(np.log(start)), -np.inf, np.inf
        best, best_miss, known = (hidden, 0.0), np.inf, (np.nan, np.nan)
        for _ in range(self.tries):
            trial = self.clamped(replace(hidden, params=scaled(law, hidden.params, float(np.exp(x)))))
            ratio = max(measure(trial), 1e-5)
            miss = float(np.log(ratio / target))
            if abs(miss) < best_miss:
                best, best_miss = (trial, ratio), abs(miss)
            if abs(miss) < self.close:
                break
            low, high = (max(low, x), high) if miss < 0 else (low, min(high, x))
            slope = (miss - known[1]) / (x - known[0]) if x != known[0] else np.nan
            known = (x, miss)
            step = -miss / (slope if np.isfinite(slope) and 0.1 < slope < 1e3 else 1.0)
            x += float(np.clip(step, -self.stride, self.stride))
            if not low < x < high:
                x = 0.5 * (low + high)
        return best


def rigidly(points: Array, onto: Array) -> Array:
    """Points `(n, 3)` after the best rigid motion onto others (Kabsch 1976)."""
    a, b = points.mean(axis=0), onto.mean(axis=0)
    U, _, Vt = np.linalg.svd((points - a).T @ (onto - b))
    turn = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return (points - a) @ turn + b


def with_column(values: Array, j: int, new: Array) -> Array:
    """Copy of `(n, k)` values with one column changed."""
    changed = np.array(values)
    changed[:, j] = new
    return changed


def plain(values: Params) -> Params:
    """Values that JSON can hold: an infinite number is written as text."""
    return {
        k: "inf" if isinstance(v, float) and np.isinf(v) else list(v) if isinstance(v, tuple) else v
        for k, v in values.items()
    }
