"""What the regression benchmarks share: the data sets, and how a set of predictions is scored."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from residual_field import simulate_reaches
from support import real_data
from threadpoolctl import threadpool_limits

from gpcorrect import se3
from gpcorrect.gpr import FeatureMap
from gpcorrect.logs import read_log
from gpcorrect.rigid import pose_residual, register
from gpcorrect.types import FloatArray, IntArray
from gpcorrect.velocity import segment_labels, twists

QUERY_SECONDS, FEWEST_QUERIES = 30.0, 20
QUERIES = 3000
REACH_RATE = 20.0  # samples a second of the simulated reaches, for the correlation time only


@dataclass(frozen=True, eq=False)
class Split:
    """Training and held-out rows of one data set, with the training's trajectories and times."""

    name: str
    X: FloatArray
    Y: FloatArray
    trajectory: IntArray
    times: FloatArray
    X_test: FloatArray
    Y_test: FloatArray
    feature_groups: tuple[tuple[int, ...], ...]


def simulated(n_reaches: int = 300, n_test: int = 60, seed: int = 0, noise_correlation: float = 0.0) -> Split:
    """Simulate reaches of 64 samples; the last `n_test` are held out."""
    samples = 64
    rng = np.random.default_rng(seed)
    data = simulate_reaches(n_reaches + n_test, samples, rng, noise_correlation=noise_correlation)
    train = data.trajectory < n_reaches
    times = np.tile(np.arange(samples) / REACH_RATE, n_reaches + n_test)
    name = "simulated, correlated noise" if noise_correlation else "simulated"
    return _split(
        name, data.positions, data.rotations, data.twists, data.residuals, data.trajectory, times, train, ~train
    )


def real() -> Split:
    """Read the wrist of a real dVRK after registration; the last 20 % of the trajectories are held out."""
    log = read_log(real_data("dvrk_random.csv"))
    train = log.trajectory < np.quantile(log.trajectory_ids, 0.8)
    rigid = register(log.tracker_cp[train], log.setpoint_cp[train], log.trajectory[train], "auto").model
    reference = rigid.apply(log.tracker_cp)
    rotations = se3.matrix_from_quaternion(reference.quaternion)
    labels = segment_labels(log.time, log.trajectory)
    twist = twists(log.time, reference.position, rotations, labels)
    usable = np.isfinite(twist).all(axis=1)
    residual = pose_residual(reference, log.setpoint_cp)
    rows = train & usable, ~train & usable
    return _split("dvrk_random", reference.position, rotations, twist, residual, log.trajectory, log.time, *rows)


def _split(
    name: str,
    positions: FloatArray,
    rotations: FloatArray,
    twist: FloatArray,
    residual: FloatArray,
    trajectory: IntArray,
    times: FloatArray,
    train: FloatArray,
    test: FloatArray,
) -> Split:
    features = FeatureMap(("pose", "velocity")).fit(positions[train], rotations[train], twist[train])
    X = features.transform(positions, rotations, twist)
    return Split(
        name, X[train], residual[train], trajectory[train], times[train], X[test], residual[test], features.groups
    )


def scores(data: Split, mean: FloatArray, std: FloatArray) -> dict[str, float]:
    """Root mean square error of position (mm) and rotation (deg), negative log predictive density, coverage in percent.

    The density is that of outputs of unit spread, the mean over outputs.
    """
    error = data.Y_test - mean
    size = np.sqrt((error.reshape(len(error), 2, 3) ** 2).sum(axis=2).mean(axis=0))
    z, spread = error / std, data.Y_test.std(axis=0)
    density = 0.5 * np.log(2 * np.pi) + np.log(std / spread) + 0.5 * z**2
    return {
        "rmse_mm": 1e3 * float(size[0]),
        "rmse_deg": float(np.rad2deg(size[1])),
        "nlpd": float(density.mean()),
        "coverage95_percent": 100 * float((np.abs(z) < 1.96).mean()),
    }


def query_times(query: Callable[[FloatArray], object], X: FloatArray, count: int = QUERIES) -> tuple[float, float]:
    """Median and 99th percentile of one query, microseconds, on one BLAS thread after a warm-up.

    A model that takes long is asked less often than `count` times, for about `QUERY_SECONDS`.
    """
    with threadpool_limits(1):
        start, warm = time.perf_counter(), 0
        while warm < max(20, count // 10) and (warm < 3 or time.perf_counter() - start < QUERY_SECONDS / 10):
            query(X[warm % len(X)])
            warm += 1
        count = int(np.clip(QUERY_SECONDS * warm / (time.perf_counter() - start), FEWEST_QUERIES, count))
        elapsed = np.empty(count)
        for i in range(count):
            x = X[i % len(X)]
            start = time.perf_counter_ns()
            query(x)
            elapsed[i] = time.perf_counter_ns() - start
    return float(np.median(elapsed)) / 1e3, float(np.percentile(elapsed, 99)) / 1e3
