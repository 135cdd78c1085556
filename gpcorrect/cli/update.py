"""`gpcorrect update`, `drift` and `explore`: the life of a model in use."""

from __future__ import annotations

import csv
import io
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Self

import typer

from gpcorrect.atomic import require_own, write_file
from gpcorrect.cli.console import err, note, out, print_json, progress_bar, show_errors, styled
from gpcorrect.cli.options import Columns, Holdout, Json, Logs, ModelFile, Report, Seed, renamed, report_page
from gpcorrect.cli.reading import Reading, read_logs
from gpcorrect.errors import DataError, LogError

if TYPE_CHECKING:
    from gpcorrect.calibration import Ageing, Detection, Measured, Proposal, Update
    from gpcorrect.types import FloatArray, IntArray

NOT_WRITTEN = 1  # exit status, as of a check that fails
UNSEEN = 0.2  # fraction of new samples that the model's points see too little of to learn there; chosen by hand
POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
TWIST = ("vx", "vy", "vz", "wx", "wy", "wz")


def update(
    model: ModelFile,
    logs: Logs,
    reading: Reading,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Model file to write; by default MODEL is replaced.")
    ] = None,
    holdout: Holdout = 0.2,
    force: Annotated[bool, typer.Option("--force", help="Write also where the held-out error grew.")] = False,
    json: Json = False,
) -> None:
    """Add the observations of new recordings to a model; its size and the time of a query stay.

    Old and new model are measured on new trajectories that were held out. Where the error grew nothing is written
    (exit status 1) unless --force is given.

    Examples
    --------
    gpcorrect update model.gpc tuesday.csv

    gpcorrect update model.gpc tuesday.csv --output tuesday.gpc --json
    """
    from gpcorrect.calibration import load, require_model_place, save, update_model

    target = output or model
    require_model_place(target)
    corrector = load(model)
    log, clocks = corrector.on_one_clock(reading.log(logs), reading.clock_left)
    known = corrector.learned_from(log)
    if known:
        hint = (
            "Learned twice it counts for more than was measured. Give new recordings alone; all of them: gpcorrect fit"
        )
        raise LogError(f"{known}.", path=log.name, hint=hint)
    note(*clocks.notes, *corrector.cautions(log))
    with progress_bar(quiet=json) as progress:
        found = update_model(corrector, log, holdout=holdout, progress=progress)
    written = force or not found.worse
    if written:
        save(found.corrector, target)
    if json:
        print_json(
            {
                "n_added": found.n_added,
                "keep": found.keep,
                "unseen": found.unseen,
                "before": found.before.to_dict() if found.before else None,
                "after": found.after.to_dict() if found.after else None,
                "worse": list(found.worse),
                "output": str(target) if written else None,
            }
        )
    else:
        _show_update(found, target, written=written)
    if not written:
        raise typer.Exit(NOT_WRITTEN)


def _show_update(found: Update, target: Path, *, written: bool) -> None:
    if found.before is not None and found.after is not None:
        for name, evaluation in (("before the update", found.before), ("after it", found.after)):
            errors = evaluation.clean_errors
            show_errors(f"Held-out new trajectories, {name}", {"corrected": errors["corrected"]})
        covered = [100 * e.to_dict()["coverage95"] for e in (found.before, found.after)]
        out.print(f"95 % intervals cover {covered[0]:.1f} % before and {covered[1]:.1f} % after")
    else:
        note("nothing was held out, so nothing is known of the updated model's error")
    out.print(f"{found.n_added} samples added; the old data have {100 * found.keep:.0f} % of their weight left")
    if found.unseen > UNSEEN:
        note(
            f"{100 * found.unseen:.0f} % of the new motion went where the training never was: "
            "fit anew to old and new recordings to learn there"
        )
    if found.worse:
        err.print(styled(("worse:", "yellow"), f" the held-out error grew in {' and '.join(found.worse)}"))
    out.print(f"model: {target}" if written else "nothing was written; write all the same with --force")


def drift(
    model: Annotated[Path, typer.Argument(help="Model file that `gpcorrect fit` or `gpcorrect joint fit` wrote.")],
    logs: Logs,
    reading: Reading,
    age: Annotated[
        list[float] | None,
        typer.Option(help="Days from the fit to each log, one a log, rising. By default: recorded hours so far."),
    ] = None,
    false_alarms: Annotated[float, typer.Option(help="Mean trajectories between false alarms, at least.")] = 1000.0,
    worn_out: Annotated[float, typer.Option(help="Worn out: errors this many times those at the fit.")] = 2.0,
    report: Report = None,
    old_plot: Annotated[Path | None, renamed("--plot", "--report", "drawings are pages")] = None,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Tell from recordings, oldest first, whether a model has aged, and estimate its remaining useful time.

    Motions longer than 20 s are watched in pieces, for recordings are often one long motion. Recordings that the model
    was made from are left out; how fast it ages takes three others.

    Examples
    --------
    gpcorrect drift model.gpc monday.csv tuesday.csv wednesday.csv --report drift.html

    gpcorrect drift model.gpc week1.csv week2.csv --age 7 --age 14 --json
    """
    import numpy as np

    from gpcorrect.calibration import JointCorrector, detect, estimate_ageing, load_any
    from gpcorrect.logs import refuse_twice

    page = report_page(report)
    _require_ages(age, logs)
    corrector = load_any(model)
    baseline = np.asarray(corrector.summary.get("baseline", ()), dtype=np.float64)
    parts, beside, ages, recorded = [], [], [], 0.0
    of_joints = isinstance(corrector, JointCorrector)
    recordings = [reading.joint_log([path]) if of_joints else reading.log([path]) for path in logs]
    refuse_twice(recordings)
    for i, (path, log) in enumerate(zip(logs, recordings, strict=True)):
        matched, clocks = corrector.on_one_clock(log, reading.clock_left)
        for sentence in (*clocks.notes, *corrector.cautions(log)):
            note(f"{path}: {sentence}")
        if corrector.learned_from(log):
            note(f"{path}: left out")
            parts.append(np.empty(0))
        else:
            measured = corrector.measure(matched, corrector.clean_afresh(matched).keep)
            parts.append(measured.scores)
            if measured.scores.size:
                beside.append(_Beside.of(path, baseline, measured))
            else:
                note(f"{path}: no trajectory lies in the model's training region")
        recorded += sum(float(np.ptp(log.time[rows])) for _, rows in log.trajectories()) / 3600
        ages.append(recorded if age is None else age[i])
    scores = np.concatenate(parts)
    if scores.size == 0:
        known = all(corrector.learned_from(log) for log in recordings)
        why = "all of these recordings made the model" if known else "no new trajectory lies in its training region"
        raise DataError(
            f"{why}: its age cannot be estimated.", hint="Give recordings of the same task from after the fit."
        )
    rng = np.random.default_rng(seed)
    found = detect(baseline, scores, false_alarms, rng)
    larger = [one for one in beside if one.chance * len(beside) * false_alarms <= 1]
    counts = [len(part) for part in parts]
    where = np.repeat(np.arange(len(logs)), counts)
    ageing = estimate_ageing(baseline, scores, np.repeat(ages, counts), where, worn_out, rng)
    unit = "hours recorded" if age is None else "days"
    lines = [f"at the fit: {baseline.size} trajectories, score {baseline.mean():.2f}", *map(str, beside)]
    words = (_drift_verdict(found, where, logs, larger), _ageing_words(ageing, unit))
    if page is not None:
        from gpcorrect.report import write_drift_report  # the report's libraries are an extra

        write_drift_report(baseline, found, ageing, [logs[i].name for i in where], (*words, *lines), page)
    if json:
        first = larger[0].log if larger else None
        print_json(
            {
                "alarm": found.alarm is not None or bool(larger),
                "alarm_log": first if found.alarm is None else str(logs[int(where[found.alarm])]),
                "alarm_trajectory": found.alarm,
                "recordings": [asdict(one) for one in beside],
                **{name: getattr(found, name) for name in ("evidence", "threshold", "scores")},
                "unit": unit,
                **{n: getattr(ageing, n) for n in ("ageing", "slope", "slope95", "remaining", "remaining95")},
            }
        )
        return
    for line in lines:
        out.print(line)
    out.print(styled((words[0], "" if found.alarm is None and not larger else "bold red")))
    out.print(words[1])


@dataclass(frozen=True)
class _Beside:
    """Trajectories of one recording beside those left out of the fit."""

    log: str
    trajectories: int
    score: float  # mean
    coverage95: float  # of all components' errors
    coverage95_worst: float  # of the component that is held most seldom
    chance: float  # of ranks as high where nothing changed

    @classmethod
    def of(cls, path: Path, baseline: FloatArray, measured: Measured) -> Self:
        from gpcorrect.calibration import chance_of_larger

        scores, worst = measured.scores, min(share for share in measured.coverage95 if share == share)
        chance = chance_of_larger(baseline, scores)
        return cls(str(path), scores.size, float(scores.mean()), measured.share_held, float(worst), chance)

    def __str__(self) -> str:
        """Return a line: how large its errors are beside the model's intervals."""
        return (
            f"{self.log}: {self.trajectories} trajectories, score {self.score:.2f}, 95 % intervals cover"
            f" {100 * self.coverage95:.0f} %, of the worst component {100 * self.coverage95_worst:.0f} %"
        )


def _require_ages(age: list[float] | None, logs: list[Path]) -> None:
    """Refuse ages that are not one a log, or not in the order of the logs, which come oldest first."""
    if age is None:
        return
    if len(age) != len(logs):
        raise DataError(f"give one --age a log: {len(logs)} logs, {len(age)} ages.", hint="In the order of the logs.")
    if not all(earlier <= later for earlier, later in pairwise(age)):
        hint = "Give the logs oldest first, and their ages in the same order."
        raise DataError(f"the ages of logs rise from one to the next, got {', '.join(map(str, age))}.", hint=hint)


def _drift_verdict(found: Detection, where: IntArray, logs: list[Path], larger: list[_Beside]) -> str:
    if found.alarm is None and larger:
        return (
            f"drift: errors larger than at the fit in {' and '.join(one.log for one in larger)}"
            f"; where nothing changed ranks are as high once in {1 / max(one.chance for one in larger):.2g} recordings"
        )
    if found.alarm is None:
        return f"no alarm: evidence of drift reached {found.evidence.max():.3g} of {found.threshold:g}"
    return (
        f"drift: alarm at trajectory {found.alarm + 1} of {len(found.scores)}, in {logs[int(where[found.alarm])]}"
        f"; a false one comes at most once in {found.threshold:g} on average"
    )


def _ageing_words(ageing: Ageing, unit: str) -> str:
    from gpcorrect.calibration.drift import FEWEST_LOGS

    if ageing.ageing is None:
        return f"how fast it ages cannot be told from fewer than {FEWEST_LOGS} new recordings"
    if ageing.remaining is None or ageing.remaining95 is None:
        return "not ageing: errors do not grow with time beyond chance, so no end is in sight"
    if ageing.remaining == 0:
        return f"worn out already: the score is {ageing.level:.3g}, the limit {ageing.limit:.3g}"
    low, high = ageing.remaining95
    until = f"{high:.3g}" if high < float("inf") else "no end in sight"
    return f"ageing: worn out in about {ageing.remaining:.3g} {unit} (95 %: {low:.3g} to {until})"


def explore(
    model: ModelFile,
    n: Annotated[int, typer.Option(help="Number of observations to propose.")] = 20,
    task: Annotated[
        Path | None, typer.Option(help="Recording that shows the task region; the training region by default.")
    ] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="CSV file to write.")] = None,
    columns: Columns = None,
    seed: Seed = 0,
    json: Json = False,
) -> None:
    """Propose the poses and velocities that reduce the uncertainty in the task region most, best first.

    Poses are in the frame that the model is asked in: m, wxyz, m/s, rad/s. Whether the arm can reach them safely is
    for you to check. Useful where a recording covers a part of the task only: after a few dozen postures over all of
    it, as many random ones were as good or better (docs/adaptation.md).

    Examples
    --------
    gpcorrect explore model.gpc --n 20 --output next.csv

    gpcorrect explore model.gpc --task suturing.csv --json
    """
    import numpy as np

    from gpcorrect.calibration import load, propose

    if output is not None:
        require_own(output, b"x,y,z,", "list of proposals")
    if columns is not None and task is None:
        raise DataError("--columns maps the recording of --task, which was not given.", hint="Give both, or neither.")
    corrector = load(model)
    region = None
    if task is not None:
        log = corrector.in_joint_order(read_logs([task], columns))
        samples = corrector.samples(log, corrector.clean_afresh(log).keep)
        region = samples.X[samples.rows]
    found = propose(corrector, n, np.random.default_rng(seed), region)
    rows = _proposals(found)
    table = _csv(rows)
    if output is not None:
        write_file(output, table)
    if json:
        print_json({"proposals": rows})
        return
    if output is None:
        typer.echo(table, nl=False)
    else:
        out.print(f"{len(rows)} proposals: {output}")
    err.print(f"uncertainty left in the task region after all of them: {100 * found.remaining[-1]:.1f} % of today's")
    note(
        "that is the model's own count, and errors may fall by less: random postures over the ranges of all joints can "
        "do as well or better"
    )


def _proposals(found: Proposal) -> list[dict[str, float]]:
    rows = []
    for i, position in enumerate(found.positions):
        row = dict(zip(POSE, position.tolist(), strict=False))
        if found.quaternions is not None:
            row |= dict(zip(POSE[3:], found.quaternions[i].tolist(), strict=True))
        if found.twists is not None:
            row |= dict(zip(TWIST, found.twists[i].tolist(), strict=False))
        rows.append({**row, "remaining": float(found.remaining[i])})
    return rows


def _csv(rows: list[dict[str, float]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: f"{value:.9g}" for name, value in row.items()} for row in rows)
    return text.getvalue()
