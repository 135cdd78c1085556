"""`gpcorrect validate`: the dry run of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from gpcorrect.cli.console import out, print_json
from gpcorrect.cli.options import Arm, Columns, Json, Namespace, Tracker
from gpcorrect.logs import ValidationReport, read_log, validate_log

__all__ = ["validate"]

STYLE = {"error": "bold red", "warning": "yellow", "info": "dim"}


def validate(
    log: Annotated[Path, typer.Argument(help="Recording to look at.", show_default=False)],
    columns: Columns = None,
    namespace: Namespace = None,
    tracker_topic: Tracker = None,
    arm: Arm = None,
    json: Json = False,
) -> None:
    """Look at a recording before fitting: rates, gaps, stamps, frozen signals, units, limits, swapped arms.

    Exit status 0 when it can be used (warnings included), 2 when something must be mended first.

    Example: gpcorrect validate monday.bag --namespace PSM2
    """
    recording = read_log(
        log, columns=columns, namespace=namespace, tracker_topic=tracker_topic, arm=arm, disorder="keep"
    )
    report = validate_log(recording)
    if json:
        print_json(report.to_dict())
    else:
        _show(report)
    if not report.ok:
        raise typer.Exit(2)


def _show(report: ValidationReport) -> None:
    facts = Table(title="What the recording holds", title_justify="left", show_header=False)
    for name, value in report.facts.items():
        facts.add_row(name, str(value))
    out.print(facts)
    if not report.findings:
        out.print("[green]nothing to mend[/]")
    for finding in report.findings:
        style = STYLE[finding.severity]
        out.print(f"[{style}]{finding.severity:8}[/] {finding.signal}: {finding.message}".replace(" : ", " "))
