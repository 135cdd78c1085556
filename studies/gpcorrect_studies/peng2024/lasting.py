"""How a calibration lasts: hours of idling, unloaded and loaded running (Fig. 6), and homings (Fig. 9)."""

from __future__ import annotations

from typing import Any

import numpy as np

from gpcorrect.joint_corrector import JointCorrector, Method
from gpcorrect.types import CalibrationLog
from gpcorrect_studies.peng2024.fits import Cell, Run, Workbench, cell, rmse

__all__ = ["LOAD", "figure_6", "figure_9"]

LOAD = 0.5  # kg
USES: dict[str, tuple[float | None, bool]] = {
    "idle": (None, True),
    "unloaded": (None, False),
    "loaded 500 g": (LOAD, False),
}
LASTING: tuple[Method, ...] = ("linear", "network", "gp")
ZERO_MINUTES = 1.0


def figure_6(bench: Workbench) -> dict[str, dict[str, Any]]:
    """Errors after hours of use, of models of the fresh robot: RMSE and, with its sign, the mean."""
    run, hours = Run(bench.scope.directions[-1], bench.scope.sparsities[-1]), bench.scope.hours

    def use(name: str) -> dict[str, Any]:
        load, idle = USES[name]
        log = bench.study.after_hours(hours, bench.scope.minutes, load, idle=idle)
        tests = [log.select(rows) for _, rows in log.trajectories()]
        return {
            "hours": list(hours),
            "rmse": {m: [cell(rmse(model, t) for model in bench.models(run, m)) for t in tests] for m in LASTING},
            "mean": {m: [cell(_mean(model, t) for model in bench.models(run, m)) for t in tests] for m in LASTING},
        }

    return dict(zip(USES, bench.parts("Fig. 6", USES, use), strict=True))


def figure_9(bench: Workbench) -> list[dict[str, Any]]:
    """Errors after each homing: none or one seen in training, and with a new zero from one minute."""
    direction, sparsity = bench.scope.directions[-1], bench.scope.middle
    unseen, seen = Run(direction, sparsity), Run(direction, sparsity, homings_seen=1)

    def after(session: int) -> dict[str, Any]:
        test = bench.study.random_run(bench.scope.minutes, session=session, salt=80 + session)
        minute = bench.study.random_run(ZERO_MINUTES, session=session, salt=60 + session)

        def three(method: Method) -> dict[str, Cell]:
            models = bench.models(unseen, method)
            return {
                "none seen": cell(rmse(model, test) for model in models),
                "one seen": cell(rmse(model, test) for model in bench.models(seen, method)),
                "new zero": cell(rmse(model.rezeroed(minute), test) for model in models),
            }

        return {"homings": session, "rmse": {method: three(method) for method in LASTING}}

    return bench.parts("Fig. 9", range(bench.scope.homings + 1), after)


def _mean(model: JointCorrector, log: CalibrationLog) -> list[float]:
    """Mean of truth minus estimate of the joints, deg, deg and mm."""
    data = model.data(log, needs_truth=True)
    assert data.truth is not None
    left = data.truth - model.estimate(data).q
    mean: list[float] = (np.nanmean(left, axis=0) * np.array([np.rad2deg(1.0), np.rad2deg(1.0), 1e3])).tolist()
    return mean
