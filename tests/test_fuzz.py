"""A short run of the fuzzers of `bench/fuzz.py`: damaged recordings and altered model files, all kinds."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from gpcorrect.logs.reader import FORMATS

ROOT = Path(__file__).resolve().parent.parent
BENCH = ROOT / "bench"


def fuzzed(*chosen: str) -> str:
    """Run the fuzzers; return what they print."""
    command = [sys.executable, str(BENCH / "fuzz.py"), *chosen, "--seed", "1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900, cwd=BENCH, check=False)
    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return done.stdout


def test_no_damaged_recording_comes_through_as_anything_but_words() -> None:
    """No traceback, crash, hang or request for memory, of any format that is read."""
    printed = fuzzed("--only", "readers", "--mutations", "4")
    assert {known.title for known in FORMATS} <= set(re.findall(r"\(([^)]+)\): {", printed))


def test_no_altered_model_comes_through_as_anything_but_words() -> None:
    """Likewise, of a linear model file of every task."""
    assert "3 kinds" in fuzzed("--only", "models", "--flips", "60", "--kind", "linear")
