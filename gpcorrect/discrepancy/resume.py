"""A run that leaves its stages in a folder, and goes on from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gpcorrect.discrepancy.outcome.result import Evidence
from gpcorrect.discrepancy.outcome.store import StageStore, inputs_key
from gpcorrect.discrepancy.run import RunSettings, find_discrepancy
from gpcorrect.sim import Model, model_from_dict
from gpcorrect.types import CalibrationLog, Progress

__all__ = ["STAGES", "Finished", "find_or_resume"]

STAGES = "stages"  # folder of the finished stages, in the output folder


@dataclass(frozen=True, eq=False)
class Finished:
    """What a run leaves.

    Parameters
    ----------
    report : mapping
        `Discrepancy.to_dict()`.
    evidence : Evidence
        What the figures are drawn from.
    model : Model
        With the named effects.
    kept : bool
        Whether all of it was there already.
    """

    report: Mapping[str, Any]
    evidence: Evidence
    model: Model
    kept: bool


def find_or_resume(
    log: CalibrationLog, model: Model, settings: RunSettings, folder: Path, progress: Progress | None = None
) -> Finished:
    """Run the workflow, or what is left of it, with its stages kept in a folder.

    Parameters
    ----------
    log, model, settings : CalibrationLog, Model, RunSettings
        As for :func:`~gpcorrect.discrepancy.run.find_discrepancy`.
    folder : Path
        Output folder. Stages of other inputs found there count as absent, and are overwritten.
    progress : Progress, optional
        Told of every stage.

    Raises
    ------
    DataError
        The log lacks a needed signal or is too short to split.
    """
    store = StageStore(
        folder / STAGES, inputs_key(log.digest, len(log), model.model_dump_json(), settings, version("gpcorrect"))
    )
    report, evidence = store.load("report"), store.load_evidence()
    if report is not None and evidence is not None:
        return Finished(report["report"], evidence, model_from_dict(report["model"]), kept=True)
    found = find_discrepancy(log, model, settings, progress, store)
    values = found.model.model_dump(mode="json", exclude_none=True)
    store.save_evidence(found.evidence)
    store.save("report", {"report": found.to_dict(), "model": values})
    return Finished(found.to_dict(), found.evidence, found.model, kept=False)
