"""What every command shares: tables and progress for people, JSON for programs, one line for errors, report pages."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from gpcorrect.atomic import atomic_path
from gpcorrect.cli.options import rejected_table
from gpcorrect.errors import DataError, GpCorrectError
from gpcorrect.plain import json_ready
from gpcorrect.types import Progress as ProgressCallback

if TYPE_CHECKING:
    from gpcorrect.calibration import Evaluation, Experiment, FitSettings
    from gpcorrect.cleaning import CleaningReport
    from gpcorrect.types import CalibrationLog

BAD_INPUT = 2  # exit status, as of a wrong option


class _Plain(Console):
    """Words come out as they are: brackets in them are no markup, and control characters are shown and not obeyed."""

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, markup=False, emoji=False, soft_wrap=True, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        return super().render_str(_visible(text), **options)


class _Remarks(_Plain):
    """Standard error: a remark that cannot be written (a full disk) is lost, and the command goes on."""

    def print(self, *objects: Any, **options: Any) -> None:
        with suppress(OSError):
            super().print(*objects, **options)


out = _Plain(width=10_000)  # wider than any table: the terminal wraps, and no number is cut off
err = _Remarks(stderr=True)


def bad_input(error: GpCorrectError) -> int:
    """Print what is wrong with the input in one clear message; return the exit status.

    Parameters
    ----------
    error : GpCorrectError
    """
    err.print(styled(("error:", "bold red"), " ", error.message))
    if error.hint:
        err.print(styled(("  try:", "bold"), " ", error.hint))
    return BAD_INPUT


def note(*remarks: str) -> None:
    """Print remarks that are no errors, a line each.

    Parameters
    ----------
    *remarks : str
    """
    for remark in remarks:
        err.print(styled(("note:", "yellow"), " ", remark))


def styled(*parts: str | tuple[str, str]) -> Text:
    """Return a line of texts, or of texts with their styles.

    Parameters
    ----------
    *parts : str or (str, str), text; with a style as rich names it, such as "bold red"
    """
    pairs = [(part, "") if isinstance(part, str) else part for part in parts]
    return Text.assemble(*((_visible(text), style) for text, style in pairs))


def _visible(text: str) -> str:
    """Return a text with its control characters, and what no file can be written in, as escapes."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in text)


def print_json(value: Any) -> None:
    """Print a value as JSON on standard output: the only thing there when `--json` was given.

    Parameters
    ----------
    value : Any, mappings, lists, arrays and scalars, nested; what JSON cannot hold becomes what it can
    """
    typer.echo(json.dumps(json_ready(value), indent=2))


def print_result(facts: Mapping[str, Any], words: str, *, as_json: bool) -> None:
    """Print what a command did: for people in a line, for programs as JSON.

    Parameters
    ----------
    facts, words, as_json
        As for :func:`print_json`; the line; whether `--json` was given.
    """
    if as_json:
        print_json(facts)
    else:
        out.print(words)


def split_names(text: str | None, option: str) -> tuple[str, ...]:
    """Return the names of a comma-separated option, none where it was not given; DataError where it names nothing.

    Parameters
    ----------
    text : str or None
    option : str, such as "--features"
    """
    names = tuple(name.strip() for name in (text or "").split(",") if name.strip())
    if text is not None and not names:
        raise DataError(f"{option} names nothing, got {text!r}.", hint="Leave it out for the usual ones.")
    return names


class _Bar(ProgressCallback):
    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._tasks: dict[str, TaskID] = {}

    def step(self, stage: str, done: float) -> None:
        if stage not in self._tasks:
            self._tasks[stage] = self._progress.add_task(stage, total=1.0)
        self._progress.update(self._tasks[stage], completed=done)


@contextmanager
def progress_bar(*, quiet: bool = False) -> Iterator[ProgressCallback]:
    """Show the stages of long work with time left on standard error; nothing when that is not a terminal.

    Parameters
    ----------
    quiet : bool
    """
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=err, disable=quiet or not err.is_terminal, transient=True) as progress:
        yield _Bar(progress)


def plain_table(*columns: str, title: str | None = None, left: int = 1) -> Table:
    """Return an empty table without rules.

    Parameters
    ----------
    *columns, title : str, titles, of the columns and of the table
    left : int, how many columns, the first ones, are flush left; the others are flush right
    """
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    for number, column in enumerate(columns):
        table.add_column(column, justify="left" if number < left else "right", no_wrap=True)
    return table


def show_errors(title: str, errors: Mapping[str, Any]) -> None:
    """Print the table of errors before, after the rigid part, and corrected.

    Parameters
    ----------
    title : str
    errors : mapping
        Of each method: `position_mm` and, where known, `rotation_deg`, each with a `norm` of mean, sd, p95 and max.
    """
    table = plain_table("", "mm: mean", "SD", "p95", "max", "deg: mean", "SD", "p95", "max", title=title)
    for name, parts in errors.items():
        leaves = (parts["position_mm"]["norm"], parts.get("rotation_deg", {}).get("norm"))
        cells = [f"{leaf[k]:.3f}" if leaf else "-" for leaf in leaves for k in ("mean", "sd", "p95", "max")]
        table.add_row(name, *cells)
    out.print(table)


def certainty(figures: Mapping[str, Any]) -> str:
    """Return what a measurement says of its intervals and of the training region, in a line.

    Axes (x, y, z; rx, ry, rz of rotations) whose intervals hold too few errors are named: the mean of all hides one.

    Parameters
    ----------
    figures : mapping, of `Evaluation.to_dict`
    """
    from gpcorrect.calibration.evaluate import LEAST_HELD

    names = ("coverage95", "coverage95_dirty", "in_domain", "in_domain_dirty")
    held, held_all, inside, inside_all = (f"{100 * figures[name]:.1f} %" for name in names)
    axes = figures.get("coverage95_axes", {})
    few = [f"{100 * part:.0f} % along {axis}" for axis, part in axes.items() if part < LEAST_HELD]
    only = f", but {' and '.join(few)}" if few else ""
    return f"95 % intervals cover {held}{only} ({held_all} of all samples); {inside} in domain ({inside_all} of all)"


def digests(*paths: Path) -> list[tuple[str, str]]:
    """Return names and SHA-256 of files and folders, for the foot of a page.

    Parameters
    ----------
    *paths : Path, files, or folders of pictures
    """
    from gpcorrect.logs.reader import recording_digest

    return [("file", f"{path}, SHA-256 {recording_digest(path)}") for path in paths]


def fitted(
    log: CalibrationLog, settings: FitSettings, output: Path, page: Path | None, *, quiet: bool, **how: Any
) -> Experiment:
    """Fit a model and measure it; write its file and, where a page is asked for, that and cleaning.csv.

    Parameters
    ----------
    log : CalibrationLog
    settings : FitSettings
    output, page : Path, and Path or None
        Model file, and HTML file where one is asked for.
    quiet : bool
    **how
        Further arguments of :func:`gpcorrect.calibration.run_experiment`.
    """
    from gpcorrect.calibration import run_experiment, save

    with progress_bar(quiet=quiet) as progress:
        experiment = run_experiment(log, settings, progress=progress, **how)
    save(experiment.corrector, output)
    if page is not None:
        from gpcorrect.report import write_fit_report  # the report's libraries are an extra

        write_fit_report(experiment, page)
        reports = {"train": experiment.fit.cleaning}
        if experiment.evaluation is not None:
            reports["held out"] = experiment.evaluation.cleaning
        _write_dropped(reports, page)
    return experiment


def dropped_words(counts: Mapping[str, int]) -> str:
    """Return how many samples cleaning rejected, and why.

    Parameters
    ----------
    counts : mapping, by reason
    """
    return ", ".join(f"{count} {reason}" for reason, count in counts.items() if count) or "none"


def write_evaluation_page(
    evaluation: Evaluation, log: CalibrationLog, model: Path, notes: Sequence[str], page: Path | None
) -> None:
    """Write the page of a model measured on recordings, and cleaning.csv, where it is asked for.

    Parameters
    ----------
    evaluation : Evaluation
    log : CalibrationLog
    model, page : Path, and Path or None
        The model's file, and the HTML file.
    notes : sequence of str, what the command noticed
    """
    if page is None:
        return
    from gpcorrect.report import write_evaluation_report

    write_evaluation_report(evaluation, log, page, notes, model.name)
    _write_dropped({"measured": evaluation.cleaning}, page)


def _write_dropped(reports: Mapping[str, CleaningReport], page: Path) -> None:
    rows: list[dict[str, Any]] = [{"set": name, **row} for name, report in reports.items() for row in report.to_table()]
    with atomic_path(rejected_table(page)) as path, path.open("w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]) if rows else ["set"])
        writer.writeheader()
        writer.writerows(rows)
