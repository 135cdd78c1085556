"""`gpcorrect validate`, `topics` and `convert`: the dry run of a recording, what is in it, and its native form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gpcorrect.cli import options as opt
from gpcorrect.cli.console import out, plain_table, print_json, styled
from gpcorrect.cli.reading import MOTION, Reading, arm_chosen, chain_of, mappings, refuse_unused_clock, seconds_ahead

if TYPE_CHECKING:
    from gpcorrect.calibration import Use
    from gpcorrect.logs import ValidationReport
    from gpcorrect.logs.order import Disorder

STYLE = {"error": "bold red", "warning": "yellow", "info": "dim"}


def validate(
    log: Annotated[Path, typer.Argument(help="Recording to look at.")],
    columns: opt.Columns = None,
    arm: opt.Arm = None,
    tracker_topic: opt.Tracker = None,
    machine: opt.MachineName = None,
    tracker_log: opt.TrackerLog = None,
    time_offset: Annotated[
        str,
        typer.Option(
            help="Clock of --tracker-log: auto (matched by the motion), none, or seconds it runs ahead. Without it, "
            "motion: look at the log with its outside sensors shifted as their motion says."
        ),
    ] = "auto",
    purpose: Annotated[
        str | None,
        typer.Option(
            "--for", help="Judge by one purpose: fit, joint, tracker (a file for --tracker-log), discrepancy."
        ),
    ] = None,
    drop_disordered: opt.Disordered = False,
    old_namespace: opt.OldNamespace = None,
    json: opt.Json = False,
) -> None:
    """Look at a recording before fitting: rates, gaps, stamps, frozen signals, units, limits, swapped arms.

    Exit status 0 when it can be used (warnings included), 2 when something must be mended first.

    Examples
    --------
    gpcorrect validate monday.bag --arm PSM2

    gpcorrect validate robot.csv --tracker-log "Take 2026-11-21.csv"

    gpcorrect validate "Take 2026-11-21.csv" --for tracker
    """
    from gpcorrect.calibration import PURPOSES, Use, for_purpose, with_outside_joints, with_poses, with_uses
    from gpcorrect.logs import read_log, validate_log, with_tracker
    from gpcorrect.logs.sync import shifted_by_motion

    refuse_unused_clock(time_offset, tracker_log)
    disorder: Disorder = "drop" if drop_disordered else "keep"
    columns, columns_beside = (columns, columns) if tracker_log is None else mappings(columns)
    recording = read_log(log, columns=columns, tracker_topic=tracker_topic, disorder=disorder, **arm_chosen(arm))
    if tracker_log is not None:
        take = read_log(tracker_log, columns=columns_beside, disorder="drop" if drop_disordered else "refuse")
        recording = with_tracker(recording, take, seconds_ahead(time_offset))
    elif time_offset == MOTION:
        recording = shifted_by_motion(recording)
    if machine is not None:
        chain = chain_of(machine)
        recording = with_outside_joints(with_poses(recording, chain), chain)
    uses: tuple[Use, ...]
    if purpose is None:
        report, uses = with_uses(validate_log(recording), recording)
    else:
        opt.one_of(purpose, tuple(PURPOSES), "--for")
        report = for_purpose(validate_log(recording), recording, purpose)
        uses = (Use(purpose),) if report.ok else ()
    if json:
        print_json({**report.to_dict(), "uses": {use.command: use.refusal or True for use in uses}})
    else:
        _show(report, uses)
    if not report.ok:
        raise typer.Exit(2)


def topics(
    log: Annotated[Path, typer.Argument(help="Recording to look into.")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the proposed mapping file here.")] = None,
    json: opt.Json = False,
) -> None:
    """List what is in a recording, topics, bodies, markers or columns, and propose a mapping file.

    Example: gpcorrect topics monday.bag --output map.toml
    """
    from gpcorrect.atomic import require_new, write_file
    from gpcorrect.logs.contents import contents_of

    if output is not None:
        require_new(output)
    found = contents_of(log)
    if output is not None:
        write_file(output, found.mapping)
    if json:
        print_json({"format": found.title, "parts": [asdict(part) for part in found.parts], "mapping": found.mapping})
        return
    table = plain_table("name", "kind", "samples", "")
    for part in found.parts:
        table.add_row(part.name, part.kind, str(part.samples), part.detail)
    out.print(f"{log}: {found.title}")
    out.print(table)
    out.print(f"a mapping file ({output or 'save it and give it with --columns'}):")
    typer.echo(found.mapping, nl=False)


def convert(
    log: Annotated[Path, typer.Argument(help="Recording to read.")],
    output: Annotated[Path, typer.Argument(help="Native log to write: CSV or Parquet by its ending.")],
    reading: Reading,
    json: opt.Json = False,
) -> None:
    """Write a recording of any known format as a native log: SI units, one clock, a column a number.

    Example: gpcorrect convert monday.bag monday.parquet --arm PSM2
    """
    from gpcorrect.atomic import require_new
    from gpcorrect.logs import require_writable, write_log

    require_writable(output)
    require_new(output)
    refuse_unused_clock(reading.time_offset, reading.tracker_log)
    recording = replace(reading, as_is=True).log([log])
    write_log(recording, output)
    if json:
        facts = {"output": str(output), "samples": len(recording), "signals": list(recording.signals)}
        print_json({**facts, "extra_columns": sorted(recording.extra), "remarks": list(recording.remarks)})
        return
    for remark in recording.remarks:
        out.print(styled(("read    ", "dim"), " ", remark))
    out.print(f"{len(recording)} samples of {', '.join(recording.signals)} -> {output}")


def _show(report: ValidationReport, uses: tuple[Use, ...]) -> None:
    facts = report.facts
    out.print(f"{facts['name']}: {_recording(facts)}")
    table = plain_table("signal", "missing", "range")
    table.columns[-1].justify = "left"
    for name, signal in facts["signals"].items():
        spans = zip(signal["min"] or (), signal["max"] or (), strict=True)
        ranges = "  ".join(f"{low:.3g}..{high:.3g}" for low, high in spans)
        turned = " + orientation" if signal["orientation"] else ""
        table.add_row(name, f"{100 * signal['missing']:.2g} %", ranges + turned)
    out.print(table)
    for remark in facts["remarks"]:
        out.print(styled(("read    ", "dim"), " ", remark))
    for finding in report.findings:
        about = f"{finding.signal}: " if finding.signal else ""
        out.print(styled((f"{finding.severity:8}", STYLE[finding.severity]), " ", about, finding.message))
        if finding.hint and finding.severity != "info":
            out.print(styled("         ", (finding.hint, "dim")))
    able = [use.command for use in uses if not use.refusal]
    for use in uses if able else ():
        if use.refusal:
            out.print(styled((f"{'not for':8} {use.command}: {use.refusal}", "dim")))
    verdict = f"can be used for {', '.join(able)}" if report.ok else "mend the errors first"
    counts = f"{len(report.errors)} errors, {len(report.warnings)} warnings"
    out.print(styled((verdict, "bold"), f" ({counts})"))


def _recording(facts: Mapping[str, Any]) -> str:
    """Return size, duration and rate of a recording in a sentence."""
    count = facts["trajectories"]["count"]
    rate = f", {facts['rate_hz']:.4g} Hz" if facts["rate_hz"] else ""
    machine = " ".join(text for text in (facts["robot"], facts["arm"]) if text)
    known = f", {machine}" if machine else ""
    motions = "1 trajectory" if count == 1 else f"{count} trajectories"
    return f"{facts['samples']} samples, {motions}, {facts['seconds']:.1f} s{rate}{known}"
