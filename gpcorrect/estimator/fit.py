"""Fit a position estimator on whole trajectories, and measure it on the others."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, get_args

import numpy as np

from gpcorrect.errors import DataError, LogError
from gpcorrect.estimator.data import EstimatorData, estimator_data, stated_frame
from gpcorrect.estimator.estimator import EstimatorMethod, PositionEstimator
from gpcorrect.estimator.state import state_columns
from gpcorrect.joint.calibrators import NetworkCalibrator, PolynomialCalibrator
from gpcorrect.joint.coupled_play import CoupledPlay, learn_coupled_play
from gpcorrect.joint.maps import NetworkMap, PolynomialMap, Scaler
from gpcorrect.joint.shown import turns_back
from gpcorrect.joint_corrector.gp import GPMap, learn_gp
from gpcorrect.rigid import RigidModel, fit_position
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal, Progress

__all__ = ["ESTIMATOR_METHODS", "EstimatorExperiment", "EstimatorSettings", "evaluate_estimator", "fit_estimator"]

ESTIMATOR_METHODS: tuple[EstimatorMethod, ...] = get_args(EstimatorMethod)
FEWEST = 50  # samples
RIDGE = 1e-5


@dataclass(frozen=True)
class EstimatorSettings:
    """How to fit.

    Parameters
    ----------
    method : str
        "gp" on chosen features (joints, slack, efforts), "network" on the whole state, or "linear".
    holdout : float
        Share of whole trajectories, the last ones, to measure on.
    layers : tuple of int
        Of the network. The paper's has batch normalisation between its layers; scikit-learn's has none, and scaled
        inputs and outputs, logistic layers and weight decay take its place.
    epochs : int
        Of the network.
    inducing : int
        Points that the Gaussian process rests on.
    extra : tuple of str
        Extra columns of the log that belong to the state.
    seed : int
        Of everything random.
    """

    method: EstimatorMethod = "gp"
    holdout: float = 0.2
    layers: tuple[int, ...] = (600, 500, 400)
    epochs: int = 60
    inducing: int = 400
    extra: tuple[str, ...] = ()
    seed: int = 0


@dataclass(frozen=True, eq=False)
class EstimatorExperiment:
    """A fit, and its errors on held-out trajectories (see :func:`evaluate_estimator`); empty without any."""

    estimator: PositionEstimator
    n_train: int
    n_test: int
    seconds: float
    errors: Mapping[str, Any] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of `gpcorrect vision fit`."""
        return {
            "method": self.estimator.method,
            "n_train": self.n_train,
            "n_test": self.n_test,
            "seconds": self.seconds,
            "state_numbers": len(self.estimator.state_names),
            **self.errors,
        }


def fit_estimator(
    log: CalibrationLog, settings: EstimatorSettings | None = None, progress: Progress | None = None
) -> EstimatorExperiment:
    """Learn from all but the last trajectories of `log`, and measure on those.

    Parameters
    ----------
    log : CalibrationLog
        With measured_jp, measured_cp, tracker_cp, and whatever else the robot reports.
    settings : EstimatorSettings, optional
        How.
    progress : Progress, optional
        Told of the Gaussian process' steps.

    Raises
    ------
    LogError
        Signals are missing, or nothing can be held out.
    DataError
        The method is unknown, or too few samples are complete.
    """
    settings = settings or EstimatorSettings()
    if settings.method not in ESTIMATOR_METHODS:
        raise DataError(f"an estimator is one of {', '.join(ESTIMATOR_METHODS)}; got {settings.method!r}.")
    begun = time.perf_counter()
    data = estimator_data(log, settings.extra)
    train = _training(data, settings.holdout)
    rows = np.flatnonzero(train & data.usable)
    if len(rows) < FEWEST:
        raise DataError(f"an estimator needs at least {FEWEST} complete samples to learn from, got {len(rows)}.")
    names = state_columns(log, settings.extra)[0]
    estimator = _fitted(data, rows, names, stated_frame(log), settings, progress)
    seconds = time.perf_counter() - begun
    estimator = replace(estimator, summary={"n_train": len(rows), "fit_seconds": seconds})
    held = np.flatnonzero(~train & data.usable)
    errors = _errors(estimator, data, held) if held.size else {}
    return EstimatorExperiment(estimator, len(rows), len(held), seconds, errors)


def evaluate_estimator(estimator: PositionEstimator, log: CalibrationLog) -> dict[str, Any]:
    """Measure an estimator on a log it has not seen.

    Returns
    -------
    dict
        `raw`, `rigid` and `estimated`, each with `rms_mm` and `sd_mm` in space and a list an axis; `rms_reduction` and
        `sd_reduction` in per cent of raw. Raw is what the robot reports, with the frames as the log states them
        (`tracker_base` in its sidecar), or after the best rigid motion of the training where it does not; rigid is
        after that motion always.

    Raises
    ------
    LogError
        Signals are missing, or no sample is complete.
    """
    data = estimator_data(log, estimator.extra)
    rows = np.flatnonzero(data.usable)
    if not rows.size:
        raise LogError("no sample has a state and a label.", path=log.name)
    return _errors(estimator, data, rows)


def _training(data: EstimatorData, holdout: float) -> BoolArray:
    """Mark samples of all trajectories but the last ones."""
    if not 0 <= holdout < 1:
        raise DataError(f"the held-out share lies between 0 and 1; got {holdout}.")
    _, first = np.unique(data.trajectory, return_index=True)
    ids = data.trajectory[np.sort(first)]
    held = max(1, round(holdout * len(ids))) if holdout > 0 else 0
    if held >= len(ids):
        raise LogError(
            f"of {len(ids)} trajectories none can be held out.", hint="Record several motions, or say --holdout 0."
        )
    kept: BoolArray = ~np.isin(data.trajectory, ids[len(ids) - held :])
    return kept


def _fitted(
    data: EstimatorData,
    rows: IntArray,
    names: tuple[str, ...],
    stated: RigidModel | None,
    settings: EstimatorSettings,
    progress: Progress | None,
) -> PositionEstimator:
    assert data.seen is not None
    rigid = fit_position(PoseSignal(data.seen[rows]), PoseSignal(data.position[rows]))
    registration = stated or rigid
    low, high = data.q[rows].min(axis=0), data.q[rows].max(axis=0)
    half = np.maximum((high - low) / 2, 1e-9)
    error = data.error(registration)
    dof = data.q.shape[1]
    play = CoupledPlay(np.eye(dof), np.full(dof, 1e-4))
    if settings.method != "network":
        path = (data.q - (low + high) / 2) / half
        play = learn_coupled_play(path, error, data.new, rows, turns_back(path, data.new))
    with_effort = data.effort is not None and bool(np.isfinite(data.effort[rows]).all())
    bare = PositionEstimator(
        settings.method,
        registration,
        rigid,
        (low + high) / 2,
        half,
        play,
        with_effort,
        PolynomialMap(0, Scaler(np.zeros(0), np.ones(0)), np.zeros((1, 3)), np.zeros(3)),
        np.zeros(3),
        names,
        settings.extra,
    )
    learned, zero = _learned(bare.features(data)[rows], error[rows], data, rows, settings, progress)
    return replace(bare, learned=learned, zero=zero)


def _learned(
    X: FloatArray,
    Y: FloatArray,
    data: EstimatorData,
    rows: IntArray,
    settings: EstimatorSettings,
    progress: Progress | None,
) -> tuple[GPMap | NetworkMap | PolynomialMap, FloatArray]:
    match settings.method:
        case "gp":
            columns = np.arange(X.shape[1])
            trajectory, at = data.trajectory[rows], data.time[rows]
            return learn_gp(
                X, Y, trajectory, at, columns, inducing=settings.inducing, seed=settings.seed, progress=progress
            )
        case "network":
            network = NetworkCalibrator(settings.layers, settings.epochs, batch=256, random_state=settings.seed)
            return _map(network.fit(X, Y).map_), np.zeros(3)
        case "linear":
            return _map(PolynomialCalibrator(1, RIDGE).fit(X, Y).map_), np.zeros(3)


def _map(learned: Any) -> NetworkMap | PolynomialMap:
    assert isinstance(learned, NetworkMap | PolynomialMap)
    return learned


def _errors(estimator: PositionEstimator, data: EstimatorData, rows: IntArray) -> dict[str, Any]:
    raw = data.error(estimator.registration)
    left = raw - (estimator.estimate(data).position - data.position)
    rows = rows[np.isfinite(left[rows]).all(axis=1)]
    before, after = _spread(raw[rows]), _spread(left[rows])
    rigid = _spread(data.error(estimator.rigid)[rows])
    return {
        "raw": before,
        "rigid": rigid,
        "estimated": after,
        "rms_reduction": 100.0 * (1.0 - after["rms_mm"] / before["rms_mm"]),
        "sd_reduction": 100.0 * (1.0 - after["sd_mm"] / before["sd_mm"]),
        "rms_reduction_beyond_rigid": 100.0 * (1.0 - after["rms_mm"] / rigid["rms_mm"]),
    }


def _spread(error: FloatArray) -> dict[str, Any]:
    """RMS and SD (about the mean, axis by axis) of errors `(n, 3)`, in mm."""
    mm = 1e3 * error
    rms, sd = np.sqrt(np.mean(mm**2, axis=0)), mm.std(axis=0)
    return {
        "rms_mm": float(np.linalg.norm(rms)),
        "sd_mm": float(np.linalg.norm(sd)),
        "rms_axes_mm": rms.tolist(),
        "sd_axes_mm": sd.tolist(),
    }
