"""Real model files, fitted once a run."""

from __future__ import annotations

from pathlib import Path

import pytest

from gpcorrect import artifact
from gpcorrect.corrector import fit_corrector
from gpcorrect.sim import debridement_log


@pytest.fixture(scope="session")
def model_files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two model files that answer differently."""
    folder = tmp_path_factory.mktemp("models")
    paths = folder / "monday.gpc", folder / "tuesday.gpc"
    for path, reaches in zip(paths, (6, 8), strict=True):
        artifact.save(fit_corrector(debridement_log(reaches=reaches)), path)
    return paths
