"""Tables and figures of the joint-level study: how accurate, how fast, and how a calibration lasts."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from gpcorrect.arms import arm_named
from gpcorrect.calibration import JointCorrector, JointStream
from gpcorrect.types import CalibrationLog
from gpcorrect_studies.peng2024.fits import METHODS, UNITS, Cell, Run, StudyFits, cell, rmse
from gpcorrect_studies.peng2024.recordings import ARM, all_joints, whole_state

LEARNERS: tuple[str, ...] = ("linear", "quadratic", "network")
LASTING: tuple[str, ...] = ("linear", "network", "gp")
LOAD = 0.5  # kg, as in the study
USES: dict[str, tuple[float | None, bool]] = {
    "idle": (None, True),
    "unloaded": (None, False),
    "loaded 500 g": (LOAD, False),
}
STREAMED = 2000  # samples over which an estimate is timed; chosen by hand
REZERO_MINUTES = 1.0  # of motion for a new zero after a homing; chosen by hand as little effort for a user


def table_1(fits: StudyFits, test: CalibrationLog) -> dict[str, dict[str, Cell]]:
    """Return the RMSE by training direction and method.

    Parameters
    ----------
    fits : StudyFits
    test : CalibrationLog
    """
    sparsity = fits.scope.middle.sparsity
    return fits.over("Table I", fits.scope.directions, lambda d: fits.all_rmse(Run(d, sparsity), test))


def figure_5(fits: StudyFits, test: CalibrationLog) -> list[dict[str, Any]]:
    """Return the RMSE by sparsity of the zig-zag, and the minutes it takes.

    Parameters
    ----------
    fits : StudyFits
    test : CalibrationLog
    """

    def point(sparsity: int) -> dict[str, Any]:
        run = Run(fits.scope.later, sparsity)
        minutes = float(np.ptp(fits.training(run, 0).time)) / 60.0
        return {"sparsity": sparsity, "minutes": minutes, "rmse": fits.all_rmse(run, test)}

    return list(fits.over("Fig. 5", fits.scope.sparsities, point).values())


def figure_6(fits: StudyFits) -> dict[str, dict[str, Any]]:
    """Return errors after hours of use of models of the fresh robot: RMSE and, with its sign, the mean.

    Parameters
    ----------
    fits : StudyFits
    """
    run, hours = fits.scope.longest, fits.scope.hours

    def errors(use: str) -> dict[str, Any]:
        load, idle = USES[use]
        log = fits.study.after_hours(hours, fits.scope.minutes, load, idle=idle)
        tests = [log.select(rows) for _, rows in log.trajectories()]
        return {
            "hours": list(hours),
            "rmse": {m: [fits.rmse(run, m, test) for test in tests] for m in LASTING},
            "mean": {m: [cell(_mean(model, test) for model in fits.models(run, m)) for test in tests] for m in LASTING},
        }

    return fits.over("Fig. 6", tuple(USES), errors)


def figure_8(fits: StudyFits, test: CalibrationLog) -> dict[str, Any]:
    """Return the RMSE with positions and efforts alone, and with the whole state, and the number of features.

    Parameters
    ----------
    fits : StudyFits
    test : CalibrationLog
    """
    few = fits.scope.middle
    whole = Run(few.direction, few.sparsity, state=True)
    everything = whole_state(test)
    pairs = fits.over(
        "Fig. 8",
        ("linear", "network"),
        lambda method: {"few": fits.rmse(few, method, test), "whole": fits.rmse(whole, method, everything)},
    )
    state = fits.training(whole, 0)
    signals = (state.setpoint_jp, state.measured_jp, state.measured_jv, state.measured_jf)
    count = len(state.extra) + sum(signal.shape[1] for signal in signals if signal is not None)
    return {"few": 6, "whole": count, "rmse": pairs}


def figure_9(fits: StudyFits) -> list[dict[str, Any]]:
    """Return the RMSE after each homing: none or one seen in training, and with a new zero from one minute.

    Parameters
    ----------
    fits : StudyFits
    """
    unseen, minutes = fits.scope.middle, fits.scope.minutes
    seen = Run(unseen.direction, unseen.sparsity, homings_seen=1)

    def point(session: int) -> dict[str, Any]:
        test = fits.study.random_run(minutes, session=session, salt=80 + session)
        minute = fits.study.random_run(REZERO_MINUTES, session=session, salt=60 + session)
        cells = {
            method: {
                "none seen": fits.rmse(unseen, method, test),
                "one seen": fits.rmse(seen, method, test),
                "new zero": cell(rmse(model.rezeroed(minute), test) for model in fits.models(unseen, method)),
            }
            for method in LASTING
        }
        return {"homings": session, "rmse": cells}

    return list(fits.over("Fig. 9", range(fits.scope.homings + 1), point).values())


def table_2(fits: StudyFits, test: CalibrationLog) -> dict[str, dict[str, Cell]]:
    """Return the RMSE of learning the error, and of learning the position itself.

    Parameters
    ----------
    fits : StudyFits
    test : CalibrationLog
    """
    error = fits.scope.middle
    whole = Run(error.direction, error.sparsity, end_to_end=True)
    return fits.over(
        "Table II",
        LEARNERS,
        lambda method: {"error": fits.rmse(error, method, test), "end to end": fits.rmse(whole, method, test)},
    )


def table_3(fig6: Mapping[str, Any]) -> dict[str, dict[str, dict[str, Cell]]]:
    """Return the RMSE of Fig. 6 by use, hour ("5 h") and method.

    Parameters
    ----------
    fig6 : mapping, as :func:`figure_6` returns it
    """
    return {
        use: {
            f"{hour:g} h": {method: cells[k] for method, cells in part["rmse"].items()}
            for k, hour in enumerate(part["hours"])
        }
        for use, part in fig6.items()
    }


def table_4(fits: StudyFits, tests: dict[str, CalibrationLog]) -> dict[str, dict[str, Cell]]:
    """Return the RMSE of the estimated tip through the kinematics: x, y, z and the distance, mm.

    Parameters
    ----------
    fits : StudyFits
    tests : dict, test runs by name
    """
    run = fits.scope.longest

    def row(name: str) -> dict[str, Cell]:
        test, linear = tests[name], fits.models(run, "linear")[0]
        given = {kind: cell([_tip_rmse(linear, test, kind)]) for kind in ("raw", "fixed_offset")}
        return given | {m: cell(_tip_rmse(model, test, "corrected") for model in fits.models(run, m)) for m in METHODS}

    return fits.over("Table IV", tuple(tests), row)


def table_5(fits: StudyFits, test: CalibrationLog) -> dict[str, dict[str, Any]]:
    """Return seconds to fit to the longest zig-zag, and milliseconds for a sample of a stream and of a whole path.

    Parameters
    ----------
    fits : StudyFits
    test : CalibrationLog, whose samples are estimated
    """

    def row(method: str) -> dict[str, Any]:
        models = fits.models(fits.scope.longest, method)
        start = time.perf_counter()
        models[0].correct_log(test)
        path = time.perf_counter() - start
        return {
            "fit_s": cell(float(model.summary["fit"]["seconds"]) for model in models),
            "stream_ms": _streamed_ms(models[0], test),
            "path_ms": 1e3 * path / len(test),
        }

    return fits.over("Table V", METHODS, row)


def _mean(model: JointCorrector, log: CalibrationLog) -> list[float]:
    """Mean of truth minus estimate of the joints, deg, deg and mm."""
    mean = np.nanmean(model.measure(log, np.ones(len(log), dtype=bool)).corrected, axis=0)
    errors: list[float] = (UNITS * mean).tolist()
    return errors


def _tip_rmse(model: JointCorrector, log: CalibrationLog, kind: str) -> list[float]:
    """RMSE of the tip's x, y and z and of its distance, mm; the tool's own joints rest."""
    assert log.external_jp is not None
    measured = model.measure(log, np.ones(len(log), dtype=bool))
    true = log.external_jp[measured.rows]
    arm = arm_named(ARM)
    estimated, reached = (arm.forward(all_joints(q))[:, :3, 3] for q in (true - measured.of(kind), true))
    mean_square = np.mean((1e3 * (estimated - reached)) ** 2, axis=0)
    errors: list[float] = np.sqrt(np.append(mean_square, mean_square.sum())).tolist()
    return errors


def _streamed_ms(model: JointCorrector, log: CalibrationLog) -> float:
    """Median time of one estimate in a stream, which other work of the machine hardly moves."""
    stream, spent = JointStream(model), []
    assert log.measured_jp is not None
    assert log.measured_jf is not None
    for t, q, effort in zip(log.time[:STREAMED].tolist(), log.measured_jp, log.measured_jf, strict=False):
        start = time.perf_counter()
        stream.correct(t, q, effort)
        spent.append(time.perf_counter() - start)
    return 1e3 * float(np.median(spent))
