"""How accurate and how fast: Tables I, II and V, Figs. 5 and 8, and the tip (Tables III and IV)."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from gpcorrect.arms import arm_named
from gpcorrect.joint_corrector import JointCorrector, JointStream, Method
from gpcorrect.joint_corrector.fit import METHODS as ALL_METHODS
from gpcorrect.metrics import spread
from gpcorrect.types import CalibrationLog, FloatArray
from gpcorrect_studies.peng2024.fits import METHODS, Cell, Run, Workbench, cell, rmse
from gpcorrect_studies.peng2024.state import ARM, whole_state

__all__ = ["figure_5", "figure_8", "table_1", "table_2", "table_5", "tables_3_and_4"]

LEARNERS: tuple[Method, ...] = ("linear", "quadratic", "network")
STREAMED = 2000  # samples over which an estimate is timed


def table_1(bench: Workbench, test: CalibrationLog) -> dict[str, dict[str, Cell]]:
    """RMSE by training direction and method."""
    scope = bench.scope
    rows = bench.parts("Table I", scope.directions, lambda d: bench.row(Run(d, scope.middle), test))
    return dict(zip(scope.directions, rows, strict=True))


def figure_5(bench: Workbench, test: CalibrationLog) -> list[dict[str, Any]]:
    """RMSE by sparsity of the zig-zag along all joints, and the minutes it takes."""

    def point(sparsity: int) -> dict[str, Any]:
        run = Run(bench.scope.directions[-1], sparsity)
        minutes = float(np.ptp(bench.training(run, 0).time)) / 60.0
        return {"sparsity": sparsity, "minutes": minutes, "rmse": bench.row(run, test)}

    return bench.parts("Fig. 5", bench.scope.sparsities, point)


def figure_8(bench: Workbench, test: CalibrationLog) -> dict[str, Any]:
    """Positions and efforts alone, against the whole state."""
    few = Run(bench.scope.directions[-1], bench.scope.middle)
    whole = Run(few.direction, few.sparsity, state=True)
    everything = whole_state(test)

    def pair(method: Method) -> dict[str, Cell]:
        few_models, whole_models = bench.models(few, method), bench.models(whole, method)
        return {
            "few": cell(rmse(model, test) for model in few_models),
            "whole": cell(rmse(model, everything) for model in whole_models),
        }

    methods: tuple[Method, ...] = ("linear", "network")
    pairs = bench.parts("Fig. 8", methods, pair)
    state = bench.training(whole, 0)
    signals = (state.setpoint_jp, state.measured_jp, state.measured_jv, state.measured_jf)
    count = len(state.extra) + sum(signal.shape[1] for signal in signals if signal is not None)
    return {"few": 6, "whole": count, "rmse": dict(zip(methods, pairs, strict=True))}


def table_2(bench: Workbench, test: CalibrationLog) -> dict[str, dict[str, Cell]]:
    """Learning the error, against learning the position itself."""
    error = Run(bench.scope.directions[-1], bench.scope.middle)
    whole = Run(error.direction, error.sparsity, end_to_end=True)

    def pair(method: Method) -> dict[str, Cell]:
        return {
            "error": cell(rmse(model, test) for model in bench.models(error, method)),
            "end to end": cell(rmse(model, test) for model in bench.models(whole, method)),
        }

    return dict(zip(LEARNERS, bench.parts("Table II", LEARNERS, pair), strict=True))


def tables_3_and_4(bench: Workbench, tests: dict[str, CalibrationLog]) -> dict[str, dict[str, Cell]]:
    """Distance from the estimated to the true tip through the kinematics, mm, by test run and method."""
    run = Run(bench.scope.directions[-1], bench.scope.sparsities[-1])

    def row(name: str) -> dict[str, Cell]:
        test = tests[name]
        linear = bench.model(run, "linear")
        names = ("raw", "fixed_offset")
        distances = {name: [_tip_rmse(linear, test, name)] for name in names}
        for method in METHODS:
            distances[method] = [_tip_rmse(model, test, "corrected") for model in bench.models(run, method)]
        return {method: cell(values) for method, values in distances.items()}

    return dict(zip(tests, bench.parts("Tables III and IV", tests, row), strict=True))


def table_5(bench: Workbench, test: CalibrationLog) -> dict[str, dict[str, Any]]:
    """Seconds to fit to the longest zig-zag; milliseconds for one sample of a stream, and for one of a whole path."""
    run = Run(bench.scope.directions[-1], bench.scope.sparsities[-1])

    def row(method: Method) -> dict[str, Any]:
        models = bench.models(run, method)
        return {
            "fit_s": cell(float(model.summary["fit_seconds"]) for model in models),
            "stream_ms": _streamed_ms(models[0], test),
            "path_ms": _path_ms(models[0], test),
        }

    methods = [method for method in ALL_METHODS if method in METHODS]
    return dict(zip(methods, bench.parts("Table V", methods, row), strict=True))


def _tip_rmse(model: JointCorrector, log: CalibrationLog, name: str) -> float:
    """RMSE of the tip, mm; the tool's own joints rest."""
    data = model.data(log, needs_truth=True)
    assert data.truth is not None
    estimates = {"raw": data.q, "fixed_offset": data.q + model.offset, "corrected": model.estimate(data).q}
    apart = 1e3 * (_tip(estimates[name]) - _tip(data.truth))
    return spread(np.linalg.norm(apart, axis=1))["rmse"]


def _tip(q: FloatArray) -> FloatArray:
    position: FloatArray = arm_named(ARM).forward(np.hstack([q, np.zeros((len(q), 3))]))[:, :3, 3]
    return position


def _streamed_ms(model: JointCorrector, log: CalibrationLog) -> float:
    """Median time of one estimate, whatever else the machine does meanwhile."""
    data, stream, spent = model.data(log), JointStream(model), []
    assert data.effort is not None
    for t, q, effort in zip(data.time[:STREAMED].tolist(), data.q, data.effort, strict=False):
        start = time.perf_counter()
        stream.estimate(t, q, effort)
        spent.append(time.perf_counter() - start)
    return 1e3 * float(np.median(spent))


def _path_ms(model: JointCorrector, log: CalibrationLog) -> float:
    data = model.data(log)
    start = time.perf_counter()
    model.estimate(data)
    return 1e3 * (time.perf_counter() - start) / len(data)
