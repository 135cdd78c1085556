"""Real model files, fitted once a run."""

from __future__ import annotations

from pathlib import Path

import pytest

from gpcorrect import artifact
from gpcorrect.corrector import FitSettings, fit_corrector
from gpcorrect.sim import debridement_log


@pytest.fixture(scope="session")
def model_files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two model files that answer differently."""
    folder = tmp_path_factory.mktemp("models")
    paths = folder / "monday.gpc", folder / "tuesday.gpc"
    settings = FitSettings(clean=False, inducing=20, marker="none", time_offset="none")
    for path, reaches in zip(paths, (4, 5), strict=True):
        artifact.save(fit_corrector(debridement_log(reaches=reaches), settings), path)
    return paths
