"""`gpcorrect explore`: where to measure next."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from gpcorrect import artifact
from gpcorrect.adaptation import Proposal
from gpcorrect.adaptation import explore as propose
from gpcorrect.atomic import atomic_path, require_folder
from gpcorrect.cli.console import err, out, print_json
from gpcorrect.cli.options import Columns, Json
from gpcorrect.corrector import log_samples
from gpcorrect.logs import read_log

__all__ = ["explore"]

POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
TWIST = ("vx", "vy", "vz", "wx", "wy", "wz")


def explore(
    model: Annotated[Path, typer.Argument(help="Model file that `gpcorrect fit` wrote.", show_default=False)],
    n: Annotated[int, typer.Option(help="Number of observations to propose.")] = 20,
    task: Annotated[
        Path | None,
        typer.Option(help="Recording that shows the task region; the training region by default.", show_default=False),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="CSV file to write.", show_default=False)
    ] = None,
    columns: Columns = None,
    seed: Annotated[int, typer.Option(help="Seed of the candidates.")] = 0,
    json: Json = False,
) -> None:
    """Propose the poses and velocities that reduce the uncertainty in the task region most, best first.

    Poses are in the frame that the model is asked in: m, wxyz, m/s, rad/s. Whether the arm can reach them safely is
    for you to check.

    Examples
    --------
    gpcorrect explore model.gpc --n 20 --output next.csv

    gpcorrect explore model.gpc --task suturing.csv --json
    """
    if output is not None:
        require_folder(output)
    corrector = artifact.load(model)
    region = None
    if task is not None:
        log = read_log(task, columns=columns)
        region = log_samples(corrector, log, corrector.clean_afresh(log).keep).X
    found = propose(corrector, n, np.random.default_rng(seed), region)
    rows = _rows(found)
    if output is not None:
        with atomic_path(output) as path:
            path.write_text(_csv(rows))
    if json:
        print_json({"proposals": rows})
        return
    if output is None:
        typer.echo(_csv(rows), nl=False)
    else:
        out.print(f"{len(rows)} proposals: {output}")
    err.print(f"uncertainty left in the task region after all of them: {100 * found.remaining[-1]:.1f} % of today's")


def _rows(found: Proposal) -> list[dict[str, Any]]:
    poses = found.positions if found.quaternions is None else np.hstack([found.positions, found.quaternions])
    rows = []
    for i, pose in enumerate(poses.tolist()):
        row = dict(zip(POSE, pose, strict=False))
        if found.twists is not None:
            row |= dict(zip(TWIST, found.twists[i].tolist(), strict=False))
        rows.append({**row, "remaining": float(found.remaining[i])})
    return rows


def _csv(rows: list[dict[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: f"{value:.9g}" for name, value in row.items()} for row in rows)
    return text.getvalue()
