"""Error at held-out motion against minutes of recording, which says when a lab may stop.

    python bench/learning_curve.py [--sets dvrk_random,dvrk_pick_place,mrdlab_spindle,simulated --seeds 3]

Of each recording the last fifth of the trajectories is held out; models learn from the first sixteenth of the rest, the
first eighth, and so on. On the simulated RAVEN-II a second curve takes its reaches not as they come: those are recorded
next that pass nearest to what `gpcorrect explore` proposes, of 160 that could be.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from support import print_table, real_data, save_results

from gpcorrect.calibration import (
    CommandCorrector,
    Corrector,
    FitSettings,
    JointCorrector,
    evaluate_model,
    fit_model,
    propose,
)
from gpcorrect.errors import GpCorrectError
from gpcorrect.logs import read_log
from gpcorrect.sim import debridement_log
from gpcorrect.types import CalibrationLog, FloatArray, IntArray
from gpcorrect.velocity import segment_labels, twists

FILES = {
    "dvrk_random": ("dvrk_random.csv", (CommandCorrector, JointCorrector)),
    "dvrk_pick_place": ("dvrk_pick_place.parquet", (JointCorrector,)),
    "mrdlab_spindle": ("mrdlab_spindle.parquet", (JointCorrector,)),
}
SHARES = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)
HELD_OUT = 0.2
POOL, TESTED, FIRST = 160, 40, 10


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", default=",".join([*FILES, "simulated"]))
    parser.add_argument("--seeds", type=int, default=3, help="simulated recordings")
    args = parser.parse_args()
    results: dict[str, Any] = {}
    for name in args.sets.split(","):
        if name == "simulated":
            results[name] = explored(args.seeds)
            continue
        file, tasks = FILES[name]
        log = read_log(real_data(file))
        for task in tasks:
            results[f"{name} {task.TASK}"] = as_it_came(f"{name}, {task.TASK}", log, task)
    save_results("learning_curve", results)


def as_it_came(title: str, log: CalibrationLog, task: type[Corrector]) -> list[list[Any]]:
    """Print the curve of a recording, and return its rows."""
    ids = np.asarray(log.trajectory_ids)
    held = max(1, round(HELD_OUT * len(ids)))
    test, rest = log.select(np.isin(log.trajectory, ids[-held:])), ids[:-held]
    rows: list[list[Any]] = []
    for share in SHARES:
        some = rest[: max(1, round(share * len(rest)))]
        if rows and rows[-1][1] == len(some):
            continue
        train = log.select(np.isin(log.trajectory, some))
        rows.append([f"{minutes(train):.2f}", len(some), *measured(train, test, task)])
    print(f"\n{title}: {held} trajectories held out; mm and deg")
    print_table(["minutes", "trajectories", *names(test, task), "95 % hold"], rows)
    return rows


def explored(seeds: int) -> list[list[Any]]:
    """Print two curves of simulated reaches, means over seeds, and return their rows."""
    found: dict[tuple[str, int], list[list[Any]]] = {}
    for seed in range(seeds):
        log = debridement_log(seed, reaches=POOL + TESTED)
        ids = np.asarray(log.trajectory_ids)
        test, pool = log.select(np.isin(log.trajectory, ids[POOL:])), ids[:POOL]
        for way in ("as they come", "explored"):
            chosen = pool[:FIRST]
            while True:
                train = log.select(np.isin(log.trajectory, chosen))
                corrector: Any = fit_model(train, FitSettings()).corrector
                cells = [minutes(train), *errors(corrector, test)]
                found.setdefault((way, len(chosen)), []).append(cells)
                if 2 * len(chosen) > POOL:
                    break
                left = pool[~np.isin(pool, chosen)]
                more = (
                    left[: len(chosen)] if way == "as they come" else nearest(corrector, log, left, len(chosen), seed)
                )
                chosen = np.concatenate([chosen, more])
    rows = [[way, str(n), *np.mean(cells, axis=0)] for (way, n), cells in sorted(found.items())]
    print(f"\nsimulated reaches, means of {seeds} recordings, {TESTED} held out")
    print_table(["recorded", "reaches", "minutes", "position mm", "rotation deg", "95 % hold"], rows)
    return rows


def nearest(corrector: CommandCorrector, log: CalibrationLog, left: IntArray, count: int, seed: int) -> IntArray:
    """Return the trajectories, of those left, that pass nearest to as many proposals, each its own."""
    found = propose(corrector, count, np.random.default_rng(seed))
    rows = np.flatnonzero(np.isin(log.trajectory, left) & log.tracker_cp.finite)
    there = log.tracker_cp.position[rows]
    speed = twists(log.time, log.tracker_cp.position, None, segment_labels(log.time, log.trajectory))[rows, :3]
    spread = np.hstack([there.std(axis=0), np.nanstd(speed, axis=0)])
    points = np.nan_to_num(np.hstack([there, speed])) / spread
    wanted = np.hstack([found.positions, found.twists[:, :3]]) / spread
    chosen: list[int] = []
    for point in wanted:
        away = np.where(np.isin(log.trajectory[rows], chosen), np.inf, np.linalg.norm(points - point, axis=1))
        chosen.append(int(log.trajectory[rows[np.argmin(away)]]))
    return np.array(chosen)


def minutes(log: CalibrationLog) -> float:
    """Return the time that trajectories took, without what lay between them."""
    return sum(float(np.ptp(log.time[rows])) for _, rows in log.trajectories()) / 60.0


def measured(train: CalibrationLog, test: CalibrationLog, task: type[Corrector]) -> list[Any]:
    """Return errors and coverage of a model of a recording, NaN where it determines none."""
    try:
        return errors(fit_model(train, FitSettings(), task=task).corrector, test)
    except GpCorrectError as error:
        print(f"{len(train)} samples: {error}")
        return [np.nan] * (len(names(test, task)) + 1)


def errors(corrector: Any, test: CalibrationLog) -> list[Any]:
    """Return root mean square errors, of poses where cleaning passes, and coverage in percent."""
    evaluation = evaluate_model(corrector, test)
    covered = 100.0 * float(np.nanmean(evaluation.dirty.coverage95))
    if isinstance(corrector, JointCorrector):
        return [*(row["rmse"] for row in evaluation.dirty_errors["corrected"]), covered]
    left = evaluation.clean_errors["corrected"]
    return [*(left[part]["norm"]["rmse"] for part in ("position_mm", "rotation_deg")), covered]


def names(log: CalibrationLog, task: type[Corrector]) -> list[str]:
    """Return the heads of the errors' columns."""
    if task is not JointCorrector:
        return ["position", "rotation"]
    truth: FloatArray | None = log.external_jp
    return [f"J{j + 1}" for j in range(truth.shape[1])]


if __name__ == "__main__":
    main()
