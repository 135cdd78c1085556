"""What is fitted once and shared by all tests."""

from __future__ import annotations

import pytest
from support import small_log

from gpcorrect.corrector import CommandCorrector, fit_corrector


@pytest.fixture(scope="session")
def small_corrector() -> CommandCorrector:
    """Return a corrector fitted to the small recording with the known miss."""
    return fit_corrector(small_log())
