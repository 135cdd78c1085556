"""Joint models on recordings that are not their own: learned from one, used on each other.

    python bench/joint_across.py --data FOLDER

Prints the root-mean-square error of every joint as a multiple of the error without correction, which no joint should
exceed by more than a twentieth; how many samples are said to be inside the training region; and how many of the 95 %
intervals hold. An offset that changed between two recordings (another homing) cannot be known: `rezeroed` is the same
after `joint rezero` on the first minute, judged on the rest of that session. Beside it, as a peer, a ridge regression
on joints (scikit-learn's default).
"""

from __future__ import annotations

import argparse
from itertools import permutations
from pathlib import Path

import numpy as np
from sklearn.linear_model import Ridge

from gpcorrect.calibration import FitSettings, JointCorrector, evaluate_model
from gpcorrect.calibration.fit import fit_model
from gpcorrect.logs import read_log
from gpcorrect.types import CalibrationLog, FloatArray

FILES = ("dvrk_random.csv", "dvrk_pick_place.parquet", "dvrk_wiggle_1.csv", "dvrk_wiggle_2.csv")
FIRST_MINUTE = 60.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with the real recordings")
    parser.add_argument("--method", default="gp", help="learner (default: gp)")
    parser.add_argument("--fewest", type=int, default=1000, help="samples of a recording to learn from (default: 1000)")
    args = parser.parse_args()
    logs = {name.split(".")[0]: read_log(args.data / name) for name in FILES}
    models: dict[str, JointCorrector] = {}
    print(f"{'learned -> used':38s} {'what':9s} error / raw, joint by joint")
    for learned, used in permutations(logs, 2):
        if len(logs[learned]) < args.fewest:
            continue
        if learned not in models:
            models[learned] = fit_model(logs[learned], FitSettings(method=args.method), task=JointCorrector).corrector
        log, model = logs[used], models[learned]
        title = f"{learned} -> {used}"
        show(title, "corrected", model, log)
        once = log.select(log.session == log.session[0])
        first = once.time - once.time[0] < FIRST_MINUTE
        if first.sum() < len(once) / 2:
            show("", "rezeroed", model.rezeroed(once.select(first)), once.select(~first))
        print(f"{'':38s} {'ridge':9s} {numbers(ridge(logs[learned], log))}")


def show(title: str, what: str, model: JointCorrector, log: CalibrationLog) -> None:
    evaluation = evaluate_model(model, log)
    raw, corrected = (np.array([row["rmse"] for row in evaluation.dirty_errors[name]]) for name in ("raw", "corrected"))
    inside = 100 * float(evaluation.dirty.in_domain.mean())
    held = " ".join(f"{100 * share:4.0f}" for share in evaluation.dirty.coverage95)
    print(
        f"{title:38s} {what:9s} {numbers(corrected / raw)}   in domain {inside:5.1f} %   95 % intervals hold {held} %"
    )


def ridge(train: CalibrationLog, test: CalibrationLog) -> FloatArray:
    """Return a ridge regression's errors on joints alone, of those without correction."""
    X, Y = joints(train)
    law = Ridge().fit(X, Y)
    X, Y = joints(test)
    return rms(Y - law.predict(X)) / rms(Y)


def joints(log: CalibrationLog) -> tuple[FloatArray, FloatArray]:
    reported = log.measured_jp if log.measured_jp is not None else log.setpoint_jp
    known = np.isfinite(reported).all(axis=1) & np.isfinite(log.external_jp).all(axis=1)
    return reported[known], (log.external_jp - reported)[known]


def rms(values: FloatArray) -> FloatArray:
    return np.sqrt((values**2).mean(axis=0))


def numbers(values: FloatArray) -> str:
    return " ".join(f"{value:5.2f}" for value in values)


if __name__ == "__main__":
    main()
