"""What the service asks of a corrector, and the identity that its replies carry."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from gpcorrect.types import BoolArray, Correction, FloatArray

__all__ = ["Corrector", "Model", "PathResult", "load_model"]


class PathResult(Protocol):
    """A corrected path, as `gpcorrect.corrector.PathCorrection`."""

    @property
    def positions(self) -> FloatArray:
        """(n, 3), m."""

    @property
    def quaternions(self) -> FloatArray | None:
        """(n, 4) wxyz."""

    @property
    def std(self) -> FloatArray:
        """(n, 6), m and rad."""

    @property
    def interval95(self) -> FloatArray:
        """(n, 6), m and rad."""

    @property
    def in_domain(self) -> BoolArray:
        """(n,)."""

    @property
    def status(self) -> tuple[str, ...]:
        """N names."""

    @property
    def reason(self) -> tuple[str, ...]:
        """N texts."""


class Corrector(Protocol):
    """What is served. Several threads call it at once, so answering must not change it."""

    def correct(self, pose: FloatArray, twist: FloatArray | None = None) -> Correction:
        """Return the command for one pose `(7,)` or `(3,)` and twist `(6,)`."""

    def correct_path(self, poses: FloatArray, times: FloatArray) -> PathResult:
        """Return the commands for poses `(n, 7)` or `(n, 3)` at `times` `(n,)`."""

    def info(self) -> Mapping[str, Any]:
        """Return what the model says of itself, ready for JSON."""


@dataclass(frozen=True)
class Model:
    """A corrector with the name and the hash that every reply carries."""

    corrector: Corrector
    id: str = "unnamed"
    hash: str = ""


def load_model(path: str | Path) -> Model:
    """Read and verify a model file.

    Raises
    ------
    ArtifactError
        The file is missing, truncated, altered, of a newer schema, or no model file.
    """
    # Not above: reading models needs SciPy and scikit-learn, which a server of another corrector does not.
    from gpcorrect import artifact

    return Model(artifact.load(path), id=Path(path).stem, hash=artifact.model_hash(path))
