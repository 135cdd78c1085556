"""Fit a joint calibration on whole trajectories, and measure it on the others."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, get_args

import numpy as np

from gpcorrect.errors import DataError, LogError
from gpcorrect.joint import (
    Direction,
    InputSignal,
    JointData,
    JointFeatures,
    NetworkCalibrator,
    NetworkMap,
    PolynomialCalibrator,
    PolynomialMap,
    check_moves,
    joint_data,
    learn_cable,
)
from gpcorrect.joint_corrector.ageing import piece_scores
from gpcorrect.joint_corrector.clocks import joints_on_one_clock
from gpcorrect.joint_corrector.corrector import JointCorrector, Method, zero_shift
from gpcorrect.joint_corrector.gp import GPMap, learn_gp
from gpcorrect.joint_corrector.inputs import joint_input_remarks
from gpcorrect.joint_corrector.law import law_penalties
from gpcorrect.joint_corrector.metrics import JointErrors, joint_errors, joint_units
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, Progress

__all__ = [
    "METHODS",
    "JointExperiment",
    "JointSettings",
    "evaluate_joint",
    "fit_joint",
    "method_named",
    "require_joints",
]

METHODS: tuple[Method, ...] = get_args(Method)
DEGREES = {"offset": 0, "linear": 1, "quadratic": 2}
FEWEST = 20  # samples
FEWEST_PIECES = 12


@dataclass(frozen=True)
class JointSettings:
    """How to fit.

    Parameters
    ----------
    method : str
        Which calibrator.
    features : tuple of str
        What it sees; empty for the method's own choice: position and, where logged, effort; for the Gaussian process
        velocity and memory too.
    input_signal : str or None
        "measured_jp" or "setpoint_jp"; the first that is logged when None.
    direction : str
        "estimate" or "command".
    holdout : float
        Share of whole trajectories, the last ones, to measure on.
    end_to_end : bool
        Learn the true positions themselves, not the error.
    layers : tuple of int
        Of the network.
    inducing : int
        Points that the Gaussian process rests on.
    time_offset : str
        Clock of the outside encoders: "auto", "none" or seconds.
    seed : int
        Of everything random.
    """

    method: Method = "gp"
    features: tuple[str, ...] = ()
    input_signal: InputSignal | None = None
    direction: Direction = "estimate"
    holdout: float = 0.2
    end_to_end: bool = False
    layers: tuple[int, ...] = (100, 100)
    inducing: int = 500
    time_offset: str = "auto"
    seed: int = 0


@dataclass(frozen=True, eq=False)
class JointExperiment:
    """A fit, and its errors on held-out trajectories."""

    corrector: JointCorrector
    n_train: int
    n_test: int
    seconds: float
    errors: dict[str, JointErrors] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of `gpcorrect joint fit`."""
        return {
            "n_train": self.n_train,
            "n_test": self.n_test,
            "seconds": self.seconds,
            "errors": self.errors,
            "model": dict(self.corrector.summary),
        }


def method_named(name: str) -> Method:
    """Return the method of that name.

    Raises
    ------
    DataError
        There is none.
    """
    for method in METHODS:
        if method == name:
            return method
    raise DataError(f"a method is one of {', '.join(METHODS)}; got {name!r}.")


def require_joints(log: CalibrationLog) -> None:
    """Refuse, before any work, a log from which no joint calibration can be learned.

    Raises
    ------
    LogError, DataError
        Signals are missing or their units cannot be right, too few samples are complete, or a joint never moves.
    """
    _complete(joint_data(log), np.ones(len(log), dtype=bool))


def _complete(data: JointData, chosen: BoolArray) -> IntArray:
    """Rows to learn from."""
    rows: IntArray = np.flatnonzero(chosen & data.usable)
    if len(rows) < FEWEST:
        raise DataError(f"a joint calibration needs at least {FEWEST} complete samples, got {len(rows)}.")
    check_moves(data, rows)
    return rows


def fit_joint(log: CalibrationLog, settings: JointSettings, progress: Progress | None = None) -> JointExperiment:
    """Learn from all but the last trajectories of `log`, and measure on those.

    Raises
    ------
    LogError
        Signals are missing, or nothing can be held out.
    DataError
        The data do not determine a calibration.
    """
    start = time.perf_counter()
    remarks = joint_input_remarks(log)
    signal: InputSignal = settings.input_signal or ("measured_jp" if log.measured_jp is not None else "setpoint_jp")
    log = joints_on_one_clock(log, settings.time_offset, signal)
    data = joint_data(log, signal, settings.direction)
    train, test = _split(data, settings.holdout)
    rows = _complete(data, train)
    corrector = _fitted(data, rows, settings, signal, progress)
    fitted = time.perf_counter() - start
    summary = {
        "method": settings.method,
        "features": list(corrector.features.kinds),
        "input": corrector.input_signal,
        "direction": settings.direction,
        "fit_seconds": fitted,
        "remarks": [*remarks, *corrector.features.left_out],
        **_steps(data),
    }
    held = np.flatnonzero(test & data.usable)
    summary["baseline"] = _baseline(corrector, data, held, np.union1d(rows, held)).tolist()
    corrector = replace(corrector, summary=summary)
    errors = _errors(corrector, data, held) if held.size else {}
    return JointExperiment(corrector, len(rows), len(held), time.perf_counter() - start, errors)


def evaluate_joint(corrector: JointCorrector, log: CalibrationLog, time_offset: str = "auto") -> dict[str, Any]:
    """Measure a model on a log it has not seen; the fixed offset is that of the training.

    Raises
    ------
    LogError
        A signal is missing, or no sample is complete.
    """
    log = joints_on_one_clock(log, time_offset, corrector.input_signal)
    data = corrector.data(log, needs_truth=True)
    rows = np.flatnonzero(data.usable)
    if rows.size == 0:
        raise LogError("no sample has both positions and their truth.", path=log.name)
    estimate = corrector.estimate(data)
    assert data.truth is not None
    left = (data.truth - estimate.q)[rows]
    zeros = zero_rows(corrector.types, data.session[rows], left, estimate.std[rows])
    return {"n_test": len(rows), "errors": _named(corrector, data.error[rows], left), "zeros": zeros}


def zero_rows(types: str, session: IntArray, left: FloatArray, std: FloatArray) -> list[dict[str, Any]]:
    """Return how far each joint's zero seems off in each session: after a homing, it is."""
    names, scale = joint_units(types)
    rows = []
    for number in np.unique(session):
        inside = session == number
        shift, moved = zero_shift(left[inside], std[inside])
        for j, unit in enumerate(names):
            entry = {"session": int(number), "joint": j + 1, "unit": unit, "shift": float(shift[j] * scale[j])}
            rows.append({**entry, "moved": bool(moved[j] != 0)})
    return rows


def _baseline(corrector: JointCorrector, data: JointData, held: IntArray, known: IntArray) -> FloatArray:
    """Scores of held-out pieces, for a watch on drift; of all pieces where too few were held out to rank others by."""
    if held.size:
        scores = piece_scores(corrector, data, held)
        if len(scores) >= FEWEST_PIECES:
            return scores
    return piece_scores(corrector, data, known)


def _steps(data: JointData) -> dict[str, float]:
    """Usual and shortest step between samples, s: a stream needs to know what a pause is, and what a velocity."""
    steps = np.diff(data.time)[~data.new[1:]]
    if steps.size == 0:
        return {}
    return {"step_seconds": float(np.median(steps)), "shortest_step_seconds": float(np.percentile(steps, 1))}


def _fitted(
    data: JointData, rows: IntArray, settings: JointSettings, signal: InputSignal, progress: Progress | None
) -> JointCorrector:
    features = JointFeatures.learn(_kinds(settings, data), data, rows)
    zero = np.zeros(data.q.shape[1])
    end_to_end = settings.end_to_end and settings.method != "ukf"
    if settings.method == "ukf":
        motor = _polynomial(data.q[rows], data.error[rows], 1)
        learned: Any = learn_cable(data, rows, motor)
    else:
        learned, zero = _regression(features, data, rows, settings, progress)
    return JointCorrector(
        settings.method,
        settings.direction,
        signal,
        data.types,
        features,
        learned,
        zero,
        data.error[rows].mean(axis=0),
        end_to_end,
    )


def _regression(
    features: JointFeatures, data: JointData, rows: IntArray, settings: JointSettings, progress: Progress | None
) -> tuple[PolynomialMap | NetworkMap | GPMap, FloatArray]:
    X = features.transform(data)[rows]
    known = np.isfinite(X).all(axis=1)
    X, rows = X[known], rows[known]
    target = data.error + data.q if settings.end_to_end else data.error
    Y = target[rows]
    still = np.zeros(Y.shape[1])
    match settings.method:
        case "gp":
            return learn_gp(
                X,
                Y,
                data.trajectory[rows],
                data.time[rows],
                features.smooth,
                inducing=settings.inducing,
                seed=settings.seed,
                penalties=law_penalties(features),
                progress=progress,
            )
        case "network":
            learned = NetworkCalibrator(settings.layers, random_state=settings.seed).fit(X, Y).map_
            assert isinstance(learned, NetworkMap)
            return learned, still
        case _:
            return _polynomial(X, Y, DEGREES[settings.method]), still


def _polynomial(X: FloatArray, Y: FloatArray, degree: int) -> PolynomialMap:
    learned = PolynomialCalibrator(degree).fit(X, Y).map_
    assert isinstance(learned, PolynomialMap)
    return learned


def _kinds(settings: JointSettings, data: JointData) -> Sequence[str]:
    if settings.features:
        return settings.features
    logged = () if data.effort is None or not np.isfinite(data.effort).any() else ("effort",)
    extra = ("velocity", "memory") if settings.method == "gp" else ()
    return ("position",) if settings.method in ("offset", "ukf") else ("position", *logged, *extra)


def _split(data: JointData, holdout: float) -> tuple[BoolArray, BoolArray]:
    """Masks of the training and the held-out trajectories: the last ones as recorded."""
    if not 0 <= holdout < 1:
        raise LogError(f"the held-out share must be at least 0 and below 1, got {holdout}.")
    _, first = np.unique(data.trajectory, return_index=True)
    ids = data.trajectory[np.sort(first)]
    if holdout == 0:
        return np.ones(len(data), dtype=bool), np.zeros(len(data), dtype=bool)
    if len(ids) < 2:
        raise LogError(
            "the log holds one trajectory: nothing can be held out to measure the error on.",
            hint="Number the motions in the `trajectory` column, give more logs, or measure nothing: --holdout 0",
        )
    count = min(len(ids) - 1, max(1, round(holdout * len(ids))))
    held = np.isin(data.trajectory, ids[-count:])
    return ~held, held


def _errors(corrector: JointCorrector, data: JointData, rows: IntArray) -> dict[str, JointErrors]:
    assert data.truth is not None
    return _named(corrector, data.error[rows], data.truth[rows] - corrector.estimate(data).q[rows])


def _named(corrector: JointCorrector, raw: FloatArray, left: FloatArray) -> dict[str, JointErrors]:
    named = {"raw": raw, "fixed_offset": raw - corrector.offset, "corrected": left}
    return {name: joint_errors(values, corrector.types) for name, values in named.items()}
