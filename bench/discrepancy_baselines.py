"""What one would try first, on the same signatures: stepwise BIC a sample, STLSQ (SINDy), nearest signature."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpcorrect.discrepancy.search.candidates import all_candidates
from gpcorrect.discrepancy.search.prepared import prepare_data
from gpcorrect.discrepancy.search.state import start_search
from gpcorrect.sim import Model
from gpcorrect.types import CalibrationLog

Array = NDArray[np.float64]
Place = tuple[str, object]

MOST_STEPS = 6
THRESHOLDS = (0.05, 0.1, 0.2, 0.4, 0.8)  # of STLSQ, in noise standard deviations that a term moves the residual by
ITERATIONS = 10
RIDGE = 1e-6


@dataclass(frozen=True, eq=False)
class Library:
    """Residual and signatures, each channel in units of its noise, channels on top of each other.

    Parameters
    ----------
    residual : (n,) array, measured minus simulated
    columns : (n, p) array, signatures, each of unit root mean square
    places : tuple of (name, joint), what each column is
    """

    residual: Array
    columns: Array
    places: tuple[Place, ...]


def library_of(log: CalibrationLog, model: Model, seed: int) -> Library:
    """Take residual and signatures of discovery and confirmation, as the workflow itself does."""
    prepared = prepare_data(log, model, np.random.default_rng(seed))
    dataset = prepared.dataset
    state = start_search(dataset, all_candidates(dataset.scene))
    std = np.array([n.std for n in state.whitener.noises])
    residual = dataset.residual()[dataset.training] / std
    good = np.isfinite(residual)
    columns, places = [], []
    for trace in state.traces:
        change = np.zeros(residual.shape)
        change[:, trace.change.shown] = trace.change.columns[dataset.training].sum(axis=2)
        change /= std
        size = float(np.sqrt(np.mean(change[good] ** 2)))
        if size > 0:
            columns.append(change[good] / size)
            places.append((trace.candidate.name, trace.candidate.joint))
    matrix = np.stack(columns, axis=1) if columns else np.zeros((int(good.sum()), 0))
    return Library(residual[good], matrix, tuple(places))


def stepwise_bic(library: Library) -> set[Place]:
    """Forward selection while BIC falls, every sample counted as independent (Schwarz 1978)."""
    y, x, n = library.residual, library.columns, len(library.residual)
    chosen: list[int] = []
    best = n * np.log(np.mean(y**2))
    while len(chosen) < MOST_STEPS:
        left = _left(y, x[:, chosen])
        others = [i for i in range(x.shape[1]) if i not in chosen]
        if not others:
            break
        pick = max(others, key=lambda i: float(x[:, i] @ left) ** 2 / float(x[:, i] @ x[:, i]))
        score = n * np.log(np.mean(_left(y, x[:, [*chosen, pick]]) ** 2)) + (len(chosen) + 1) * np.log(n)
        if score >= best:
            break
        chosen, best = [*chosen, pick], score
    return {library.places[i] for i in chosen}


def stlsq(library: Library) -> set[Place]:
    """Sequentially thresholded least squares (Brunton, Proctor and Kutz 2016), its threshold by BIC."""
    y, n = library.residual, len(library.residual)
    found = [_thresholded(library, t) for t in THRESHOLDS]
    scores = [n * np.log(np.mean(_left(y, library.columns[:, k]) ** 2)) + len(k) * np.log(n) for k in found]
    return {library.places[i] for i in found[int(np.argmin(scores))]}


def _thresholded(library: Library, threshold: float) -> list[int]:
    terms = list(range(library.columns.shape[1]))
    for _ in range(ITERATIONS):
        if not terms:
            break
        sizes = np.abs(_coefficients(library.residual, library.columns[:, terms]))
        smaller = [k for k, size in zip(terms, sizes, strict=True) if size >= threshold]
        if len(smaller) == len(terms):
            break
        terms = smaller
    return terms


def nearest_signature(library: Library) -> set[Place]:
    """Return the signature with the largest cosine, when a test a sample at 1 % over all of them finds anything."""
    y, x, n = library.residual, library.columns, len(library.residual)
    if x.shape[1] == 0:
        return set()
    cosine = (x.T @ y) ** 2 / (np.sum(x**2, axis=0) * float(y @ y))
    best = int(np.argmax(cosine))
    gain = 0.5 * n * -np.log(1.0 - min(float(cosine[best]), 1.0 - 1e-12))
    return {library.places[best]} if gain > np.log(100.0 * x.shape[1]) else set()


BASELINES: dict[str, Callable[[Library], set[Place]]] = {
    "stepwise BIC a sample": stepwise_bic,
    "STLSQ (SINDy)": stlsq,
    "nearest signature": nearest_signature,
}


def _coefficients(y: Array, x: Array) -> Array:
    gram = x.T @ x
    return np.linalg.solve(gram + RIDGE * len(y) * np.eye(len(gram)), x.T @ y)


def _left(y: Array, x: Array) -> Array:
    return y - x @ _coefficients(y, x) if x.shape[1] else y
