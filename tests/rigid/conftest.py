"""One seeded generator for each test."""

from __future__ import annotations

import numpy as np
import pytest


@pytest.fixture
def rng() -> np.random.Generator:
    """Return a generator of the same numbers in each test."""
    return np.random.default_rng(20140818)
