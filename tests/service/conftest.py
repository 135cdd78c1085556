"""Real model files, fitted once a run."""

from __future__ import annotations

from pathlib import Path

import pytest
from support import Once, short_search

from gpcorrect.calibration import FitSettings, fit_corrector, save
from gpcorrect.sim import debridement_log


@pytest.fixture(scope="session")
def model_files(once: Once) -> tuple[Path, Path]:
    """Two model files that answer differently; no test may write to them."""
    settings = FitSettings(clean=False, inducing=20, marker="none", time_offset="none")

    def fit(path: Path, reaches: int) -> None:
        with short_search():
            save(fit_corrector(debridement_log(reaches=reaches), settings), path)

    return once.file("monday.gpc", lambda path: fit(path, 4)), once.file("tuesday.gpc", lambda path: fit(path, 5))
