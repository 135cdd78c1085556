"""A run's finished stages, kept in its folder as JSON and plain arrays, so that a killed run goes on."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gpcorrect.atomic import atomic_path
from gpcorrect.discrepancy.outcome.result import Evidence
from gpcorrect.discrepancy.search.state import Step

__all__ = ["StageStore", "inputs_key"]

ARRAYS = ("before", "after", "motor", "direction", "sealed", "correlation")


def inputs_key(*parts: object) -> str:
    """Return the SHA-256 over what a run depends on: hashes of the data, the model, seed, versions."""
    text = json.dumps([str(p) for p in parts])
    return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True)
class StageStore:
    """A folder of stages that belong to one set of inputs; those of other inputs count as absent.

    Parameters
    ----------
    folder : Path
        Where they are; made when the first one is saved.
    key : str
        Of the inputs, from :func:`inputs_key`.
    """

    folder: Path
    key: str

    def load(self, stage: str) -> dict[str, Any] | None:
        """Return what was saved of a stage; None when there is nothing, or it is of other inputs or damaged."""
        try:
            kept = json.loads((self.folder / f"{stage}.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        if not isinstance(kept, dict) or kept.get("key") != self.key or not isinstance(kept.get("content"), dict):
            return None
        content: dict[str, Any] = kept["content"]
        return content

    def save(self, stage: str, content: Mapping[str, Any]) -> None:
        """Keep a stage: whole, or not at all.

        Raises
        ------
        GpCorrectError
            The folder cannot be written.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        with atomic_path(self.folder / f"{stage}.json") as path:
            path.write_text(json.dumps({"key": self.key, "content": content}), encoding="utf-8")

    def save_evidence(self, evidence: Evidence) -> None:
        """Keep what the figures are drawn from."""
        self.folder.mkdir(parents=True, exist_ok=True)
        texts = {
            "joint": evidence.joint,
            "labels": evidence.labels,
            "waterfall": [asdict(s) for s in evidence.waterfall],
        }
        arrays = {name: getattr(evidence, name) for name in ARRAYS}
        with atomic_path(self.folder / "evidence.npz") as path:
            np.savez_compressed(path, header=np.array(json.dumps({"key": self.key} | texts)), **arrays)

    def load_evidence(self) -> Evidence | None:
        """Return what :meth:`save_evidence` kept; None when there is nothing, or it is of other inputs or damaged."""
        try:
            with np.load(self.folder / "evidence.npz", allow_pickle=False) as kept:
                header = json.loads(str(kept["header"]))
                arrays = {name: kept[name] for name in ARRAYS}
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None
        if header.get("key") != self.key:
            return None
        steps: Sequence[Mapping[str, Any]] = header["waterfall"]
        return Evidence(
            **arrays,
            joint=tuple(header["joint"]),
            labels=tuple(header["labels"]),
            waterfall=tuple(Step(s["label"], s["nats"]) for s in steps),
        )
