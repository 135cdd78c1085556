"""Answers that must not look right: queries far outside the training, outliers in it, poses without a clock.

For every learner, joint queries 1 to 8 training ranges outside, asked as a path and as a stream: how many say that
they are in domain, and how many correct by more than training justifies. Farther ones are refused. Then a joint
recording with planted outliers, and a table of static poses, fitted with blocks held out.

    python bench/calibration_safety.py
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from support import print_table, save_results

from gpcorrect.calibration import LEARNERS, FitSettings, JointCorrector, fit_model, run_experiment
from gpcorrect.sim import debridement_log, joint_motion_log, preset
from gpcorrect.types import CalibrationLog, FloatArray

OUTLIERS = 40


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--queries", type=int, default=10_000)
    options = parser.parse_args()
    log = joint_motion_log(preset("raven2_calibration"), trajectories=6)
    rows = [far_outside(log, method, options.queries) for method in LEARNERS]
    head = ["joint queries far outside", "asked", "in domain", "beyond the bound", "as stream: in domain", "beyond"]
    print_table(head, rows)
    outliers = planted(log)
    print_table(["outliers in a joint log", "planted", "dropped", "others dropped", "of"], [outliers])
    static = static_poses()
    print_table(["static poses, blocks held out", "train", "test", "raw mm", "rigid mm", "corrected mm"], [static])
    save_results("calibration_safety", {"far": rows, "outliers": outliers, "static": static})


def far_outside(log: CalibrationLog, method: str, count: int) -> list[object]:
    corrector: JointCorrector = fit_model(log, FitSettings(method=method, inducing=100), task=JointCorrector).corrector
    features, rng = corrector.view.features, np.random.default_rng(0)
    centre, half = features.centre, features.half
    q: FloatArray = centre + half * rng.uniform(-1, 1, (count, len(centre)))
    joint = rng.integers(0, len(centre), count)
    away = half[joint] * (1 + 2 * 10 ** rng.uniform(0, 0.9, count)) * rng.choice([-1, 1], count)
    q[np.arange(count), joint] = centre[joint] + away
    limit = corrector.law.bounds.largest + np.abs(corrector.law.zero) + 1e-12
    # Each query a path of its own: the session changes from row to row.
    path = corrector.correct_path(q, np.arange(count), np.zeros(q.shape), np.arange(count))
    beyond = (np.abs(path.joints - q) > limit).any(axis=1)
    live = [corrector.stream().correct(0.0, row, np.zeros(len(centre))) for row in q[: count // 10]]
    out = sum(bool((np.abs(answer.joints - row) > limit).any()) for answer, row in zip(live, q, strict=False))
    inside = sum(bool(answer.in_domain) for answer in live)
    return [method, count, int(path.in_domain.sum()), int(beyond.sum()), f"{inside} of {len(live)}", out]


def planted(log: CalibrationLog) -> list[object]:
    rng = np.random.default_rng(1)
    truth = np.array(log.external_jp)
    bad = rng.choice(len(truth), OUTLIERS, replace=False)
    truth[bad] += rng.choice([-1, 1], (OUTLIERS, 1)) * np.array([0.3, 0.3, 0.03])
    result = fit_model(replace(log, external_jp=truth), FitSettings(method="linear"), task=JointCorrector)
    dropped = ~result.cleaning.keep
    return ["simulated RAVEN-II", OUTLIERS, int(dropped[bad].sum()), int(dropped.sum() - dropped[bad].sum()), len(log)]


def static_poses() -> list[object]:
    """Fit poses of reaches in random order, a row each, without a clock."""
    log = debridement_log(5, reaches=60, faults=False)
    rows = np.random.default_rng(2).permutation(len(log))[:600]
    table = replace(
        log.select(rows), time=np.arange(600.0), trajectory=np.arange(600), session=np.zeros(600), static=True
    )
    experiment = run_experiment(table, FitSettings(inducing=200))
    errors = experiment.evaluation.clean_errors
    means = [errors[name]["position_mm"]["norm"]["rmse"] for name in experiment.corrector.METHODS]
    return ["simulated debridement", experiment.fit.n_train, experiment.n_test, *means]


if __name__ == "__main__":
    main()
