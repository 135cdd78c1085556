"""The public door of the workflow: short, and light until it is used."""

from __future__ import annotations

import subprocess
import sys

import gpcorrect.discrepancy as door


def test_every_public_name_exists_and_no_other() -> None:
    """What the door lists can be taken from it; another name is an AttributeError."""
    assert all(getattr(door, name) is not None for name in door.__all__)
    assert not hasattr(door, "nonsense")


def test_opening_the_door_loads_no_scientific_library() -> None:
    """The simulator and compiled code are loaded by the first use, not by the import."""
    code = "import sys, gpcorrect.discrepancy; sys.exit('scipy' in sys.modules or 'numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
