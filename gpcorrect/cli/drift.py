"""`gpcorrect drift`: tells whether a model has aged, and how long it will last."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from gpcorrect import artifact
from gpcorrect.adaptation import Ageing, Detection, detect, estimate_ageing, trajectory_scores
from gpcorrect.atomic import atomic_path, require_folder
from gpcorrect.cli.console import out, print_json
from gpcorrect.cli.options import Arm, Columns, Json, Logs, Namespace, Tracker
from gpcorrect.corrector import CommandCorrector, log_samples, on_one_clock
from gpcorrect.errors import DataError
from gpcorrect.joint_artifact import is_joint_model, load_joint
from gpcorrect.joint_corrector import JointCorrector, joints_on_one_clock, piece_scores
from gpcorrect.logs import read_log
from gpcorrect.types import CalibrationLog, FloatArray, IntArray

__all__ = ["drift"]


def drift(
    model: Annotated[
        Path, typer.Argument(help="Model file that `gpcorrect fit` or `gpcorrect joint fit` wrote.", show_default=False)
    ],
    logs: Logs,
    age: Annotated[
        list[float] | None,
        typer.Option(help="Days from the fit to each log, one a log. By default: recorded hours so far."),
    ] = None,
    false_alarms: Annotated[float, typer.Option(help="Mean trajectories between false alarms, at least.")] = 1000.0,
    worn_out: Annotated[float, typer.Option(help="Worn out: errors this many times those at the fit.")] = 2.0,
    plot: Annotated[Path | None, typer.Option(help="Figure to write (PNG).", show_default=False)] = None,
    columns: Columns = None,
    time_offset: Annotated[str, typer.Option(help="Tracker's clock, as for fit: auto, none, or seconds.")] = "auto",
    seed: Annotated[int, typer.Option(help="Seed of tie-breaking and bootstrap.")] = 0,
    namespace: Namespace = None,
    tracker_topic: Tracker = None,
    arm: Arm = None,
    json: Json = False,
) -> None:
    """Tell from recordings, oldest first, whether a model has aged, and estimate its remaining useful time.

    Models of joints are watched in pieces of 20 s, as their recordings are often one long motion.

    Examples
    --------
    gpcorrect drift model.gpc monday.csv tuesday.csv wednesday.csv --plot drift.png

    gpcorrect drift model.gpc week1.csv week2.csv --age 7 --age 14 --json
    """
    if plot is not None:
        require_folder(plot)
    if age is not None and len(age) != len(logs):
        raise DataError(f"give one --age a log: {len(logs)} logs, {len(age)} ages.", hint="In the order of the logs.")
    monitored = _monitored(model)
    parts, ages, recorded = [], [], 0.0
    for i, path in enumerate(logs):
        log = read_log(path, columns=columns, namespace=namespace, tracker_topic=tracker_topic, arm=arm)
        parts.append(monitored.scores(log, time_offset))
        recorded += sum(float(np.ptp(log.time[rows])) for _, rows in log.trajectories()) / 3600
        ages.append(recorded if age is None else age[i])
    baseline = monitored.baseline
    counts = [len(part) for part in parts]
    scores = np.concatenate(parts)
    if scores.size == 0:
        raise DataError("no trajectory lies in the model's training region: nothing can be said of its age.")
    rng = np.random.default_rng(seed)
    found = detect(baseline, scores, false_alarms, rng)
    where = np.repeat(np.arange(len(logs)), counts)
    ageing = estimate_ageing(baseline, scores, np.repeat(ages, counts), where, worn_out, rng)
    unit = "hours recorded" if age is None else "days"
    if plot is not None:
        _draw(baseline, found, ageing, where, [path.name for path in logs], plot)
    if json:
        print_json(_result(found, ageing, unit, where, logs))
    else:
        _show(found, ageing, unit, where, logs)


@dataclass(frozen=True, eq=False)
class _Monitored:
    """A model under watch: the scores of its left-out training data, and how a log is scored."""

    baseline: FloatArray
    scores: Callable[[CalibrationLog, str], FloatArray]


def _monitored(path: Path) -> _Monitored:
    """Return a model of poses or of joints, whichever the file holds."""
    if is_joint_model(path):
        joints = load_joint(path)
        return _Monitored(_baseline(joints.summary), lambda log, clock: _joint_scores(joints, log, clock))
    poses = artifact.load(path)
    return _Monitored(_baseline(poses.summary), lambda log, clock: _pose_scores(poses, log, clock))


def _pose_scores(corrector: CommandCorrector, log: CalibrationLog, clock: str) -> FloatArray:
    log, _ = on_one_clock(log, clock)
    return trajectory_scores(corrector, log_samples(corrector, log, corrector.clean_afresh(log).keep))


def _joint_scores(corrector: JointCorrector, log: CalibrationLog, clock: str) -> FloatArray:
    data = corrector.data(joints_on_one_clock(log, clock, corrector.input_signal), needs_truth=True)
    return piece_scores(corrector, data, np.flatnonzero(data.usable))


def _baseline(summary: Mapping[str, Any]) -> FloatArray:
    scores = summary.get("baseline")
    if not scores:
        raise DataError("this model file does not hold the errors at its fit.", hint="Fit it again with this version.")
    return np.asarray(scores, dtype=np.float64)


def _draw(
    baseline: FloatArray, found: Detection, ageing: Ageing, where: IntArray, names: list[str], path: Path
) -> None:
    from gpcorrect import plots  # the figures' library is an extra

    picture = plots.png(plots.drift_history(baseline, found, ageing, where, names))
    with atomic_path(path) as temporary:
        temporary.write_bytes(picture)


def _result(found: Detection, ageing: Ageing, unit: str, where: IntArray, logs: list[Path]) -> dict[str, Any]:
    return {
        "alarm": found.alarm is not None,
        "alarm_log": None if found.alarm is None else str(logs[int(where[found.alarm])]),
        "alarm_trajectory": found.alarm,
        "evidence": found.evidence.tolist(),
        "threshold": found.threshold,
        "scores": found.scores.tolist(),
        "ageing": ageing.ageing,
        "unit": unit,
        "slope": ageing.slope,
        "slope95": list(ageing.slope95),
        "remaining": ageing.remaining,
        "remaining95": None if ageing.remaining95 is None else list(ageing.remaining95),
    }


def _show(found: Detection, ageing: Ageing, unit: str, where: IntArray, logs: list[Path]) -> None:
    for i, path in enumerate(logs):
        own = found.scores[where == i]
        size = f"score {own.mean():.2f}" if own.size else "outside the training region"
        out.print(f"{path}: {own.size} trajectories, {size}")
    if found.alarm is None:
        strongest = found.evidence.max()
        out.print(f"no alarm: evidence of drift reached {strongest:.3g} of {found.threshold:g}")
    else:
        out.print(
            f"[bold red]drift:[/] alarm at trajectory {found.alarm + 1} of {len(found.scores)}, in "
            f"{logs[int(where[found.alarm])]}; a false one comes at most once in {found.threshold:g} on average"
        )
    out.print(_future(ageing, unit))


def _future(ageing: Ageing, unit: str) -> str:
    if ageing.remaining is None or ageing.remaining95 is None:
        return "not ageing: errors do not grow with time beyond chance, so no end is in sight"
    low, high = ageing.remaining95
    if ageing.remaining == 0:
        return f"worn out already: the score is {ageing.level:.3g}, the limit {ageing.limit:.3g}"
    until = f"{high:.3g}" if np.isfinite(high) else "no end in sight"
    return f"ageing: worn out in about {ageing.remaining:.3g} {unit} (95 %: {low:.3g} to {until})"
