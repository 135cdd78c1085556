"""A run's finished stages in a folder, as JSON and plain arrays, so that a killed run goes on."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
from pydantic import TypeAdapter, ValidationError

from gpcorrect.atomic import atomic_path, write_file
from gpcorrect.codec import pack, unpack
from gpcorrect.discrepancy.naming.posterior import Alternative, Level, Named
from gpcorrect.discrepancy.outcome.result import DiscrepancyResult, Evidence
from gpcorrect.discrepancy.search.candidates import Candidate, FittedEffect
from gpcorrect.discrepancy.search.state import Search, Step
from gpcorrect.discrepancy.settings import SETTINGS
from gpcorrect.sim.effects import EFFECTS
from gpcorrect.sim.model import model_from_dict

FORM = 4  # of what is stored: stages of another one are of other inputs
APART = ("model", "evidence", "advised_plans", "read_back")  # of a result: with a form of their own, or without one
ALTERNATIVES = TypeAdapter(tuple[Alternative, ...])
Names = tuple[Search, tuple[Named, ...], tuple[Named, ...]]  # with the named effects only, those, and the others


def inputs_key(*parts: object) -> str:
    """Return the SHA-256 over what a run depends on: thresholds and catalogue, and what is given.

    Parameters
    ----------
    *parts : object, hashes of the data, the model, seed, versions; each as its text
    """
    catalogue = [kind.about for kind in EFFECTS.values()]
    text = json.dumps([str(p) for p in (FORM, SETTINGS, catalogue, *parts)])
    return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True)
class StageStore:
    """A folder of stages that belong to one set of inputs; those of other inputs count as absent."""

    folder: Path  # where they are; made when the first one is saved
    key: str  # of the inputs, from :func:`inputs_key`

    def load(self, stage: str) -> dict[str, Any] | None:
        """Return what was saved of a stage; None when there is nothing, or it is of other inputs or damaged.

        Parameters
        ----------
        stage : str
        """
        try:
            stored = json.loads((self.folder / f"{stage}.json").read_text(encoding="utf-8"))
            content = stored["content"] if stored["key"] == self.key else None
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return content if isinstance(content, dict) else None

    def save(self, stage: str, content: Mapping[str, Any]) -> None:
        """Store a stage: whole, or not at all.

        Parameters
        ----------
        stage : str
        content : mapping of plain values

        Raises
        ------
        GpCorrectError
            The folder cannot be written.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        write_file(self.folder / f"{stage}.json", json.dumps({"key": self.key, "content": content}))

    def save_result(self, result: DiscrepancyResult) -> None:
        """Store a finished run, all but the plans of the advised one.

        Parameters
        ----------
        result : DiscrepancyResult
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        evidence, arrays = pack(result.evidence, "evidence")
        header = json.dumps({"key": self.key, "content": evidence})
        with atomic_path(self.folder / "evidence.npz") as path:
            np.savez_compressed(path, header=np.array(header), **arrays)
        content = {n: a.dump_python(getattr(result, n), mode="json") for n, a in _adapters().items()}
        self.save("result", content | {"model": result.model.model_dump(exclude_none=True)})

    def load_result(self) -> DiscrepancyResult | None:
        """Return what :meth:`save_result` stored; None when there is nothing, or it is of other inputs or damaged."""
        if (content := self.load("result")) is None or (evidence := self._evidence()) is None:
            return None
        try:
            values = {name: adapter.validate_python(content[name]) for name, adapter in _adapters().items()}
        except (KeyError, ValidationError):
            return None
        return DiscrepancyResult(**values, model=model_from_dict(content["model"]), evidence=evidence, read_back=True)

    def _evidence(self) -> Evidence | None:
        try:
            with np.load(self.folder / "evidence.npz", allow_pickle=False) as stored:
                header = json.loads(str(stored["header"]))
                return unpack(Evidence, header["content"], stored) if header["key"] == self.key else None
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None


@cache
def _adapters() -> dict[str, TypeAdapter[Any]]:
    """Of every field of a result that is stored as plain values."""
    hints = get_type_hints(DiscrepancyResult)
    return {f.name: TypeAdapter(hints[f.name]) for f in fields(DiscrepancyResult) if f.name not in APART}


def load_or_run(
    stage: str, state: Search, candidates: Sequence[Candidate], store: StageStore | None, run: Callable[[Search], Names]
) -> Names:
    """Return what a search or a naming makes of a state, from the store where it was run before with the same inputs.

    Parameters
    ----------
    stage : str, its name in the store
    state : Search, where it starts
    candidates : sequence of Candidate, all of them, always in the same order
    store : StageStore or None, which stores nothing
    run : callable, what is done; a search names nothing
    """
    if store is not None and (stored := store.load(stage)) is not None:
        named, dropped = (tuple(_named_of(n, candidates) for n in stored[part]) for part in ("named", "dropped"))
        fitted, whitened_by = (tuple(_fit_of(f, candidates) for f in stored[p]) for p in ("fitted", "whitened_by"))
        whitened, steps = replace(state, fitted=whitened_by).refreshed(), tuple(Step(**s) for s in stored["waterfall"])
        return replace(whitened, fitted=tuple(n.fit for n in named) or fitted, waterfall=steps), named, dropped
    state, named, dropped = run(state)
    if store is not None:  # of a state its sets and the steps to them: all else follows from where its search starts
        plain: dict[str, Any] = {"waterfall": [asdict(step) for step in state.waterfall]}
        plain |= {p: [_plain_fit(f, candidates) for f in getattr(state, p)] for p in ("fitted", "whitened_by")}
        plain["named"], plain["dropped"] = ([_plain_named(n, candidates) for n in part] for part in (named, dropped))
        store.save(stage, plain)
    return state, named, dropped


def _plain_named(named: Named, candidates: Sequence[Candidate]) -> dict[str, Any]:
    alternatives = ALTERNATIVES.dump_python(named.alternatives, mode="json")
    return {**vars(named), "fit": _plain_fit(named.fit, candidates), "alternatives": alternatives}


def _named_of(stored: dict[str, Any], candidates: Sequence[Candidate]) -> Named:
    alternatives, reasons = ALTERNATIVES.validate_python(stored["alternatives"]), tuple(stored["reasons"])
    fit, level = _fit_of(stored["fit"], candidates), Level(stored["level"])
    probability, nats, spread = stored["probability"], stored["nats"], stored["spread"]
    undetermined, like_steps = tuple(stored["undetermined"]), stored.get("like_steps", False)
    return Named(fit, level, probability, nats, alternatives, reasons, spread, undetermined, like_steps)


def _plain_fit(fit: FittedEffect, candidates: Sequence[Candidate]) -> dict[str, Any]:
    place = next(i for i, c in enumerate(candidates) if c is fit.candidate)
    return {"candidate": place, "u": np.asarray(fit.u).tolist()}


def _fit_of(stored: dict[str, Any], candidates: Sequence[Candidate]) -> FittedEffect:
    return FittedEffect(candidates[stored["candidate"]], np.array(stored["u"]))
