"""A short run of the fuzzers of `bench/fuzz.py`: damaged recordings and altered model files, all kinds."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from gpcorrect.logs.reader import FORMATS

ROOT = Path(__file__).resolve().parent.parent
BENCH = ROOT / "bench"


@pytest.mark.parametrize(
    "chosen", [("--only", "readers", "--mutations", "8"), ("--only", "models", "--flips", "25", "--kind", "linear")]
)
def test_no_damaged_file_comes_through_as_anything_but_words(chosen: tuple[str, ...]) -> None:
    """No traceback, crash, hang or request for memory, of any kind of recording or model file."""
    command = [sys.executable, str(BENCH / "fuzz.py"), *chosen, "--seed", "1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900, cwd=BENCH, check=False)
    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr[-3000:]}"


def test_every_format_has_an_example_that_is_damaged() -> None:
    """A format that is added to the readers is added to the fuzzer."""
    code = (
        "import json, sys, tempfile; from pathlib import Path\n"
        "from fuzzing.examples import examples\n"
        "from gpcorrect.logs.reader import _format\n"
        "with tempfile.TemporaryDirectory() as f:\n"
        "    sys.stdout.write(json.dumps([_format(e.path).title for e in examples(Path(f))]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(BENCH)},
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert {known.title for known in FORMATS} <= set(json.loads(done.stdout))
