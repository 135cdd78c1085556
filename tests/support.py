"""What several tests share: where the real recordings are."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


def data_folder() -> Path:
    """Return the folder of real recordings: $GPCORRECT_DATA, or `shared/data` beside the checkout."""
    return Path(os.environ.get("GPCORRECT_DATA", ROOT.parent / "shared" / "data"))


def real_data(name: str) -> Path:
    """Return the path of a real recording, or skip the test where the recordings are not at hand."""
    path = data_folder() / name
    if not path.exists():
        pytest.skip(f"real recording {name} is not at hand: set GPCORRECT_DATA to the folder that holds it")
    return path
