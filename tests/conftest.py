"""What is fitted once and shared by all tests."""

from __future__ import annotations

import pytest
from hypothesis import settings
from support import small_log

from gpcorrect.corrector import CommandCorrector, fit_corrector

# How long an example takes says more of the machine's other work than of the code.
settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")


@pytest.fixture(scope="session")
def small_corrector() -> CommandCorrector:
    """Return a corrector fitted to the small recording with the known miss."""
    return fit_corrector(small_log())
