"""Ablations: a supposed cause is taken away or added, and the claim that it is blamed for is measured again.

Each returns figures in the places of the study's own, as far as it measures them, of one repeat. `claims.toml` says in
words what each changes and which claims try it.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from sklearn.neural_network import MLPRegressor

from gpcorrect.calibration import JointCorrector, fit_model, timed, zigzag
from gpcorrect.calibration.learners.network import BATCH, L2, LEARNING_RATE, NetworkMap
from gpcorrect.calibration.learners.polynomial import PolynomialMap, Scaler
from gpcorrect.sim import Model, Segment, preset
from gpcorrect.sim.effects.over_time import Drift
from gpcorrect.types import CalibrationLog
from gpcorrect_studies.peng2024.fits import UNITS, Run, StudyFits, cell, rmse
from gpcorrect_studies.peng2024.recordings import LIMITS, PRESET, SLOW, RavenStudy

HOURS = 5.0  # the last hour of the paper's Tables III and IV
MEMORY_EFFECTS = ("coulomb_friction", "backlash")  # what the arm's past leaves behind
DIRECTIONS_COMPARED = ("J1", "J2-J3", "J1-J2-J3")
# Chosen by hand: of an error that is a wave over joints 2 and 3, deg, deg, mm, and rad over the whole block.
BENT, WAVE = np.array([1.2, 1.2, 0.8]), 6.0
DRIFT_OF_JOINT_2 = 1.0 / 3.0  # of joint 1's; chosen by hand
TIMED, LOOPS = 20, 100  # the median of so many loops of calls; chosen by hand


def ablations(fits: StudyFits, test: CalibrationLog) -> dict[str, dict[str, Any]]:
    """Return the figures of the scope's ablations by name; KeyError for an unknown one.

    Parameters
    ----------
    fits : StudyFits
    test : CalibrationLog
    """
    names = tuple(ABLATIONS) if fits.scope.ablations is None else fits.scope.ablations
    return fits.over("ablations", names, lambda name: ABLATIONS[name](fits, test))


def _directions(
    fits: StudyFits,
    study: RavenStudy,
    directions: Sequence[str] = DIRECTIONS_COMPARED,
    methods: Sequence[str] = ("linear", "quadratic", "network"),
) -> dict[str, Any]:
    """Rows of Table I, measured on another study's recordings."""
    again = _once(fits, study)
    test, sparsity = again.study.random_run(fits.scope.minutes), fits.scope.middle.sparsity
    table: dict[str, Any] = {d: {m: again.rmse(Run(d, sparsity), m, test) for m in methods} for d in directions}
    for direction, row in table.items():
        if "linear" in row:
            lines = again.models(Run(direction, sparsity), "linear")
            row["fixed_offset"] = cell(rmse(model, test, "fixed_offset") for model in lines)
    return {"table1": table}


def _once(fits: StudyFits, study: RavenStudy) -> StudyFits:
    """Return fits to another study's recordings, with one repeat and in no file."""
    return StudyFits(study, replace(fits.scope, repeats=1, network_repeats=1), fits.progress)


def _without_memory() -> Model:
    model = preset(PRESET)
    return model.with_effects(*(e for e in model.effects if e.to_dict()["name"] not in MEMORY_EFFECTS))


@dataclass(frozen=True)
class _Bent(RavenStudy):
    """The arm, with an error of every joint that is a wave over joints 2 and 3: no line of positions and efforts."""

    def _log(self, paths: Sequence[Segment], salt: int) -> CalibrationLog:
        log = super()._log(paths, salt)
        assert log.measured_jp is not None
        assert log.external_jp is not None
        u = (log.measured_jp - LIMITS.mean(axis=1)) / np.ptp(LIMITS, axis=1)
        wave = np.sin(WAVE * u[:, 1]) * np.cos(WAVE * u[:, 2])
        return replace(log, external_jp=log.external_jp + (BENT / UNITS) * wave[:, None])


def _bent(fits: StudyFits, machine: Model | None) -> dict[str, Any]:
    return _directions(fits, _Bent(fits.study.seed, fits.study.homings, fits.study.as_published, machine))


def _drifting_joint_2(fits: StudyFits, _: CalibrationLog) -> dict[str, Any]:
    """Table III, unloaded, of an arm whose joint 2 drifts too."""
    model = preset(PRESET)
    first = next(effect for effect in model.effects if isinstance(effect, Drift))
    second = replace(first, joint=2, rate=DRIFT_OF_JOINT_2 * first.rate)
    again = _once(fits, replace(fits.study, machine=model.with_effects(*model.effects, second)))
    hours = again.study.after_hours((0.0, HOURS), fits.scope.minutes, None, idle=False)
    tests = [hours.select(rows) for _, rows in hours.trajectories()]
    names = zip(("0 h", f"{HOURS:g} h"), tests, strict=True)
    run = fits.scope.longest
    return {
        "table3": {
            "unloaded": {name: {m: again.rmse(run, m, log) for m in ("linear", "network")} for name, log in names}
        }
    }


def _slow(fits: StudyFits, _: CalibrationLog) -> dict[str, Any]:
    """Durations of the zig-zags at the lowest speeds of the controller's random motion."""
    rate = preset(PRESET).log_rate_hz
    seconds = {n: timed(zigzag(fits.scope.later, n, LIMITS), SLOW, rate).duration for n in (2, 3, 4)}
    return {"zigzag_s": {"2": seconds[2], "2+3+4": sum(seconds.values())}}


def _processor_time(fits: StudyFits, _: CalibrationLog) -> dict[str, Any]:
    """Processor time of a fit, of which other work of the machine is no part, compiled code loaded before."""
    run, seconds = fits.scope.longest, []
    for _turn in range(2):
        begun = time.process_time()
        fit_model(fits.training(run, 0), fits.settings(run, "linear", 0), task=JointCorrector)
        seconds.append(time.process_time() - begun)
    return {"table5": {"linear": {"fit_s": cell(seconds[1:])}}}


def _laws_alone(fits: StudyFits, _: CalibrationLog, *, library: bool = False) -> dict[str, Any]:
    """Time of one estimate of the laws alone; the network's by scikit-learn's `predict` where `library`."""
    run = fits.scope.longest
    line, net = (fits.models(run, method)[0].law.learned for method in ("linear", "network"))
    assert isinstance(line, PolynomialMap)
    assert isinstance(net, NetworkMap)
    x = line.scaler.centre[None]
    calls: dict[str, Callable[[], Any]] = {"linear": partial(line.predict, x), "network": partial(net.predict, x)}
    if library:
        inputs, targets = np.repeat(x, 2, axis=0), np.zeros((2, len(net.biases[-1])))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it is timed, and nothing is to be learned
            fitted = MLPRegressor(hidden_layer_sizes=fits.settings(run, "network", 0).layers, max_iter=1).fit(
                inputs, targets
            )
        calls = {"linear": partial(np.matmul, x, line.weights[1:]), "network": partial(fitted.predict, x)}
    return {"table5": {method: {"stream_ms": _milliseconds(call)} for method, call in calls.items()}}


def _unscaled(fits: StudyFits, test: CalibrationLog) -> dict[str, Any]:
    """Table II's network, learning the positions in deg, deg and mm as they are."""
    run, train, scaler = fits.scope.middle, fits.training(fits.scope.middle, 0), None
    parts = []
    for log in (train, test):
        assert log.measured_jp is not None
        assert log.measured_jf is not None
        assert log.external_jp is not None
        X = np.hstack([log.measured_jp, log.measured_jf])
        scaler = scaler or Scaler.of(X)
        parts.append((scaler.apply(X), UNITS * log.external_jp))
    (X, Y), (X_test, Y_test) = parts
    settings = fits.settings(run, "network", 0)
    network = MLPRegressor(
        hidden_layer_sizes=settings.layers,
        activation="logistic",
        alpha=L2,
        learning_rate_init=LEARNING_RATE,
        batch_size=min(BATCH, len(X)),
        max_iter=settings.epochs,
        n_iter_no_change=settings.epochs,
        random_state=settings.seed,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it ends after its epochs, as the study's does
        network.fit(X, Y)
    left = np.sqrt(((network.predict(X_test) - Y_test) ** 2).mean(axis=0))
    return {"table2": {"network": {"error": fits.rmse(run, "network", test), "end to end": cell([left])}}}


def _milliseconds(call: Callable[[], Any]) -> float:
    """Median time of a call."""
    spent = []
    for _ in range(TIMED):
        begun = time.perf_counter()
        for _ in range(LOOPS):
            call()
        spent.append(1e3 * (time.perf_counter() - begun) / LOOPS)
    return float(np.median(spent))


ABLATIONS: Mapping[str, Callable[[StudyFits, CalibrationLog], dict[str, Any]]] = {
    "no play or friction": lambda fits, _: _directions(fits, replace(fits.study, machine=_without_memory())),
    "errors that bend": lambda fits, _: _bent(fits, None),
    "errors that bend alone": lambda fits, _: _bent(fits, _without_memory()),
    "as published": lambda fits, _: _directions(
        fits, replace(fits.study, as_published=True), DIRECTIONS_COMPARED[1:], ("network",)
    ),
    "drift of joint 2": _drifting_joint_2,
    "slow": _slow,
    "unscaled": _unscaled,
    "processor time": _processor_time,
    "laws alone": _laws_alone,
    "library": partial(_laws_alone, library=True),
}
