"""Joint calibrators beside what a lab would write itself: every set with outside joints, three splits each.

    python bench/joint_peers.py [--sets mrdlab_spindle --splits last,first,middle --ours gp,auto]

The sets are the real ones, and eight minutes of random sweeps of the simulated RAVEN-II in stretches of 20 s.

Peers see positions, velocities (from the sample before) and, where logged, efforts; `ridge + play` also slacks of three
widths of each joint; those "of the past" also the same numbers 1, 2, 5, 10 and 20 samples ago. They are scikit-learn's,
with its defaults but for scaled inputs; its exact Gaussian process has a thousand samples of all that there are. The
temporal convolutional network, of positions, velocities and efforts of this sample and the 31 before, is in plain numpy
(bench/peers/temporal_network.py).

The last lines say how far ours is from the best peer of each joint, chosen on the test set, as no user could.
"""

from __future__ import annotations

import argparse
import time
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
from peers.temporal_network import PAST as SEQUENCE
from peers.temporal_network import TemporalNetwork
from sklearn.compose import TransformedTargetRegressor
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, WhiteKernel
from sklearn.linear_model import LinearRegression, RidgeCV
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from support import print_table, real_data, save_results

from gpcorrect.calibration import FitSettings, JointCorrector, evaluate_model, fit_model
from gpcorrect.logs import read_log
from gpcorrect.play import play_states
from gpcorrect.types import CalibrationLog, FloatArray, IntArray
from gpcorrect_studies.peng2024 import RavenStudy

SETS = {
    "dvrk_random": "dvrk_random.csv",
    "dvrk_pick_place": "dvrk_pick_place.parquet",
    "mrdlab_spindle": "mrdlab_spindle.parquet",
}
SIMULATED = "raven2_simulated"
SIMULATED_MINUTES, STRIDE, STRETCH = 8.0, 2, 20.0  # of the sweeps; every second sample; s of a trajectory
SHARE = 0.2
WIDTHS = (0.02, 0.1, 0.3)
PAST = (1, 2, 5, 10, 20)
GP_SAMPLES = 1000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", default=",".join([*SETS, SIMULATED]))
    parser.add_argument("--splits", default="last,first,middle")
    parser.add_argument("--ours", default="gp,trees,auto")
    args = parser.parse_args()
    warnings.simplefilter("ignore", ConvergenceWarning)
    results: dict[str, Any] = {}
    for name in args.sets.split(","):
        log = sweeps() if name == SIMULATED else read_log(real_data(SETS[name]))
        for split in args.splits.split(","):
            held_out = np.isin(log.trajectory, ids_of(log, split))
            results[f"{name} {split}"] = compare(f"{name}, {split} fifth held out", log, held_out, args.ours.split(","))
    worst = [[key, *row] for key, rows in results.items() for row in rows["beside best peer"]]
    print_table(["ours / best peer of each joint", "model", "worst", "of all joints"], worst)
    save_results("joint_peers", results)


def sweeps() -> CalibrationLog:
    """Return random sweeps of the simulated arm, cut into trajectories."""
    log = RavenStudy(0).random_run(SIMULATED_MINUTES)
    log = log.select(np.arange(len(log)) % STRIDE == 0)
    return replace(log, trajectory=((log.time - log.time[0]) // STRETCH).astype(np.int64))


def ids_of(log: CalibrationLog, split: str) -> IntArray:
    ids = np.asarray(log.trajectory_ids)
    k = max(1, round(SHARE * len(ids)))
    start = {"last": len(ids) - k, "first": 0, "middle": (len(ids) - k) // 2}[split]
    return ids[start : start + k]


def compare(title: str, log: CalibrationLog, held_out: np.ndarray, ours: list[str]) -> dict[str, Any]:
    """Print the table of one set and split, and return its rows."""
    train, test = log.select(~held_out), log.select(held_out)
    columns = {past: features(log, past) for past in ("", "play", "window", "sequence")}
    error = log.external_jp - reported(log)
    known = np.isfinite(error).all(axis=1) & np.all([np.isfinite(X).all(axis=1) for X in columns.values()], axis=0)
    unit = np.array([1e3 if kind == "P" else np.rad2deg(1.0) for kind in log.joint_types(error.shape[1])])

    def rms(errors: FloatArray) -> FloatArray:
        return np.sqrt((errors**2).mean(axis=0)) * unit

    Y, Z = error[~held_out & known], error[held_out & known]
    rows: list[list[Any]] = [["raw", *rms(Z), np.nan, ""], ["fixed offset", *rms(Z - Y.mean(axis=0)), np.nan, ""]]
    peers: list[FloatArray] = []
    for name, kind, make in PEERS:
        X, T = columns[kind][~held_out & known], columns[kind][held_out & known]
        start = time.perf_counter()
        some = np.linspace(0, len(X) - 1, min(len(X), GP_SAMPLES) if make is gaussian_process else len(X)).astype(int)
        targets = [Y[some]] if make is TemporalNetwork else Y[some].T
        predicted = np.column_stack([make().fit(X[some], target).predict(T) for target in targets])
        peers.append(rms(Z - predicted))
        rows.append([name, *peers[-1], time.perf_counter() - start, ""])
    best = np.min(peers, axis=0)
    beside = []
    for method in ours:
        start = time.perf_counter()
        model = fit_model(train, FitSettings(method=method), task=JointCorrector).corrector
        seconds = time.perf_counter() - start
        evaluation = evaluate_model(model, test)
        own = np.array([row["rmse"] for row in evaluation.dirty_errors["corrected"]])
        held = " ".join(f"{100 * share:.0f}" for share in evaluation.dirty.coverage95)
        rows.append([f"ours, {method}", *own, seconds, held])
        beside.append([method, float((own / best).max()), " ".join(f"{r:.2f}" for r in own / best)])
    joints = [f"J{j + 1}" for j in range(error.shape[1])]
    print(f"\n{title}: {len(train)} samples to learn from, {len(test)} to judge; deg, mm")
    print_table(["RMSE", *joints, "fit s", "95 % intervals hold %"], rows)
    return {"rows": rows, "beside best peer": beside}


def reported(log: CalibrationLog) -> FloatArray:
    return log.measured_jp if log.measured_jp is not None else log.setpoint_jp


def features(log: CalibrationLog, past: str) -> FloatArray:
    """Return positions, velocities, efforts, and what a peer remembers; pasts end where trajectories begin."""
    q, first = reported(log), np.diff(log.trajectory, prepend=log.trajectory[:1] - 1) != 0
    start = np.maximum.accumulate(np.where(first, np.arange(len(q)), 0))
    before = np.maximum(np.arange(len(q)) - 1, start)
    step = np.maximum(log.time - log.time[before], 1e-3)[:, None]
    now = [q, (q - q[before]) / step]
    if log.measured_jf is not None:
        now.append(log.measured_jf)
    X = np.hstack(now)
    if past == "play":
        half = np.nanstd(q, axis=0) * np.sqrt(3.0)
        steps = np.nan_to_num(np.diff(q / half, axis=0, prepend=q[:1] / half))
        slacks = play_states(steps, np.outer(WIDTHS, np.ones(q.shape[1])), np.cumsum(first))
        return np.hstack([X, slacks.reshape(len(q), -1)])
    if past == "sequence":
        return np.hstack([X[np.maximum(np.arange(len(q)) - k, start)] for k in reversed(range(SEQUENCE))])
    if past == "window":
        return np.hstack([X, *(X[np.maximum(np.arange(len(q)) - k, start)] for k in PAST)])
    return X


def ridge() -> Any:
    return make_pipeline(StandardScaler(), RidgeCV(np.logspace(-4, 4, 9)))


def perceptron() -> Any:
    network = MLPRegressor(hidden_layer_sizes=(100, 100), early_stopping=True, random_state=0)
    return TransformedTargetRegressor(make_pipeline(StandardScaler(), network), transformer=StandardScaler())


def gaussian_process() -> Any:
    return make_pipeline(StandardScaler(), GaussianProcessRegressor(RBF() + WhiteKernel(0.1), normalize_y=True))


PEERS = [
    ("linear", "", LinearRegression),
    ("ridge + play", "play", ridge),
    ("ridge of the past", "window", ridge),
    ("boosted trees", "", HistGradientBoostingRegressor),
    ("boosted trees + play", "play", HistGradientBoostingRegressor),
    ("boosted trees of the past", "window", HistGradientBoostingRegressor),
    ("perceptron", "", perceptron),
    ("perceptron of the past", "window", perceptron),
    ("Gaussian process", "", gaussian_process),
    ("temporal convolutional network", "sequence", TemporalNetwork),
]

if __name__ == "__main__":
    main()
