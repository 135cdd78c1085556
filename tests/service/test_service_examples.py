"""The examples in other languages and in notebooks run as they stand."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from service_support import POSE, SHIFT, server_process
from support import ROOT

EXAMPLES = ROOT / "examples"


def compiled(folder: Path) -> Path:
    """Return the C++ example as a program; the test is skipped where a compiler or zenoh-c is missing."""
    compiler, program = shutil.which("g++") or shutil.which("clang++"), folder / "correct"
    if compiler is None:
        pytest.skip("no C++ compiler")
    (folder / "try.cpp").write_text('#include "zenoh.h"\nint main() { return Z_OK; }\n')
    words = [compiler, "-std=c++17", "-Wall", "-o", str(program), "-lzenohc"]
    if subprocess.run([*words[:-1], str(folder / "try.cpp"), words[-1]], capture_output=True).returncode:
        pytest.skip("zenoh-c is not installed: https://github.com/eclipse-zenoh/zenoh-c/releases")
    subprocess.run([*words[:-1], str(EXAMPLES / "clients" / "correct.cpp"), words[-1]], check=True)
    return program


def test_the_c_plus_plus_example_is_answered(tmp_path: Path) -> None:
    """It prints the command for a pose, and the refusal of a pose in millimetres."""
    program = compiled(tmp_path)
    with server_process() as server:
        numbers = [str(number) for number in POSE]
        good = subprocess.run([program, server.endpoint, "arm1", *numbers], capture_output=True, text=True)
        bad = subprocess.run([program, server.endpoint, "arm1", "100", *numbers[1:]], capture_output=True, text=True)
    np.testing.assert_allclose(json.loads(good.stdout)["position"], POSE[:3] + SHIFT)
    assert (good.returncode, bad.returncode) == (0, 1)
    assert json.loads(bad.stderr)["status"] == "BAD_INPUT"


def test_the_notebook_runs() -> None:
    """Its cells run one after the other, and the last one shows how millimetres are refused."""
    notebook = EXAMPLES / "notebooks" / "recording_to_correction.ipynb"
    cells = ["".join(c["source"]) for c in json.loads(notebook.read_text())["cells"] if c["cell_type"] == "code"]
    names: dict[str, Any] = {}
    for cell in cells:
        exec(compile(cell, notebook.name, "exec"), names)
    assert names["reply"].status == "OK"
    assert names["refusal"][0] == "BAD_INPUT"
