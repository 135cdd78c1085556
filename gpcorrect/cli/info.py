"""`gpcorrect info`: what a model file remembers of itself."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gpcorrect.cli.console import note, out, plain_table, print_json
from gpcorrect.cli.options import Json

if TYPE_CHECKING:
    from collections.abc import Iterable

    from gpcorrect.calibration import Corrector, HeldOut, Step

DIGITS = 12
"""Hexadecimal digits of a digest that are shown to people, as in `gpcorrect models list`; JSON holds all."""


def info(model: Annotated[Path, typer.Argument(help="Model file that any fit wrote.")], json: Json = False) -> None:
    """Print what a model file remembers: task, data, each step of its making with command, versions, held-out errors.

    Example: gpcorrect info model.gpc
    """
    from gpcorrect.calibration import load_with_hash

    corrector: Corrector
    corrector, digest = load_with_hash(model)
    if json:
        described = {"file": str(model), "hash": digest, "task": corrector.TASK, "bytes": model.stat().st_size}
        print_json({**described, "history": [asdict(s) for s in corrector.history], "model": corrector.info()})
        return
    show_model(corrector, digest)


def show_model(corrector: Corrector, digest: str) -> None:
    """Print for people what a model remembers.

    Parameters
    ----------
    corrector : Corrector
        Of any task.
    digest : str
        SHA-256 of its file.
    """
    table = plain_table("", "", left=2)
    table.show_header = False
    for name, value in _facts(corrector, digest).items():
        table.add_row(name, value)
    out.print(table)
    if not corrector.history:
        note("the file is of before models kept their history: nothing is known of date, command and held-out errors")
    for step in corrector.history:
        _show_step(step)


def rmse_words(parts: Iterable[tuple[str, float]]) -> str:
    """Return errors in a few words, units once where neighbours share them: `0.41 mm 0.22 deg`.

    Parameters
    ----------
    parts : iterable of (str, float)
        Unit and RMSE of each part.
    """
    words: list[str] = []
    for unit, rmse in parts:
        if words and words[-1] == unit:
            words.pop()
        words += [f"{rmse:.3g}", unit]
    return " ".join(words) or "-"


def versions_words(step: Step) -> str:
    """Return the versions of a step in a line.

    Parameters
    ----------
    step : Step
        Of a model's making.
    """
    return ", ".join(f"{name} {number}" for name, number in step.versions.items())


def _facts(corrector: Corrector, digest: str) -> dict[str, str]:
    summary: dict[str, Any] = corrector.info()
    fit, data = summary.get("fit", {}), summary.get("data", {})
    found = {
        "task": corrector.TASK,
        "hash": digest,
        "robot": " ".join(str(part) for part in (summary.get("robot"), summary.get("arm")) if part),
        "method": f"{summary.get('method')} on {', '.join(summary.get('features', ()))}",
        "data": " ".join(str(part) for part in (data.get("source"), data.get("sha256", "")[:DIGITS]) if part),
        "trained on": f"{fit.get('n_train')} samples of {fit.get('n_trajectories')} trajectories",
        "dropped": ", ".join(f"{count} {why}" for why, count in fit.get("dropped", {}).items() if count),
        "remarks": "; ".join(summary.get("remarks", ())),
    }
    return {name: value for name, value in found.items() if value}


def _show_step(step: Step) -> None:
    out.print(f"\n{step.what} of {step.date}")
    out.print(f"  $ {step.command}")
    out.print(f"  data {step.source} {step.sha256[:DIGITS]}")
    out.print(f"  with {versions_words(step)}")
    if step.held_out is None:
        out.print("  nothing was held out")
    else:
        _show_held_out(step.held_out)


def _show_held_out(measured: HeldOut) -> None:
    table = plain_table("", "", "mean", "SD", "rmse", "p95", "max", "", left=2)
    for row in measured.errors:
        leaves = (f"{value:.4f}" for value in (row.mean, row.sd, row.rmse, row.p95, row.max))
        table.add_row(f"  {row.part}", row.method, *leaves, row.unit)
    out.print(f"  held out: {measured.samples} samples of {measured.trajectories} trajectories")
    out.print(table)
    covered, inside = 100 * measured.coverage95, 100 * measured.in_domain
    out.print(f"  95 % intervals cover {covered:.1f} %; {inside:.1f} % in domain")
