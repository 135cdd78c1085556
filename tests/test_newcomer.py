"""The newcomer's page, each line of it run as it stands."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from shown import PATIENCE, run_shown, section
from support import ROOT

from gpcorrect.sim import read_model

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("bash") is None, reason="the page's lines are for a shell: bash is not installed"),
]
PAGE = "docs/newcomer.md"


def test_every_section_is_run_here() -> None:
    """The page has the sections below and no other."""
    titles = re.findall(r"^## (.*)$", (ROOT / PAGE).read_text(), re.MULTILINE)
    assert titles == [BAG, EFFECT, PUBLIC, NOTHING]


BAG = "From a ROS bag to a served correction, in five commands"
EFFECT = "From an unknown robot to a named effect, in three commands"
PUBLIC = "A public arm from download to a named effect, in four commands"
NOTHING = "From nothing, without a robot"


def test_from_a_bag_to_a_served_correction(tmp_path: Path, ports: None) -> None:
    """Every line ends well; the query is answered as the model file answers, by the arm that was named."""
    *_, correct, serve, query = run_shown(section(PAGE, BAG), tmp_path)
    assert "gpcorrect/PSM1/correct on tcp/127.0.0.1:7449" in serve.printed
    position = re.compile(r"position \[m\] +(.*)")
    asked, served = (position.search(ran.printed) for ran in (correct, query))
    assert asked is not None
    assert served is not None
    assert asked[1] == served[1]
    assert "served by" in query.printed
    assert (tmp_path / "report" / "report.html").exists()


def test_from_an_unknown_robot_to_a_named_effect(tmp_path: Path) -> None:
    """Every line ends well, and the page's own words of the effect and its size are what is printed."""
    *_, validate, named, _ = run_shown(section(PAGE, EFFECT), tmp_path)
    assert "discrepancy" in validate.printed
    promised = re.search(r"`(Joint 2: backlash, [^ ]+) \([^`]*(closes 100 % of the gap)`", section(PAGE, EFFECT))
    assert promised is not None
    said = " ".join(named.printed.split())
    assert promised[1] in said
    assert promised[2] in said


def test_a_public_arm_from_download_to_a_named_effect(tmp_path: Path) -> None:
    """Every line ends well, and the page's own words of the effect are what is printed."""
    if find_spec("mujoco") is None:
        pytest.skip("mujoco is not installed")
    text = section(PAGE, PUBLIC)
    download, rest = (
        re.search(r"^    (pip install .*\n)", text, re.MULTILINE),
        re.sub(r"^    pip .*\n", "", text, flags=re.M),
    )
    assert download is not None
    words = [sys.executable, "-m", *download[1].split()]
    if subprocess.run(words, cwd=tmp_path, capture_output=True, timeout=PATIENCE, check=False).returncode != 0:
        pytest.skip("the arm cannot be downloaded: no package index is at hand")
    _, named, _ = run_shown(rest, tmp_path)
    promised = re.search(r"`(Joint 2: coulomb friction[^`]*)`", text)
    assert promised is not None
    assert promised[1].rstrip(".") in " ".join(named.printed.split())
    written = re.search(r'frictionloss="([^"]*)"', (tmp_path / "study" / "model.xml").read_text())
    assert written is not None
    assert float(written[1]) == pytest.approx(6.0, rel=1e-3)
    assert not read_model(tmp_path / "study" / "model.toml").effects
    (effect,) = json.loads((tmp_path / "study" / "report.json").read_text())["verdict"]["effects"]
    assert (effect["name"], effect["joint"]) == ("coulomb_friction", 2)


def test_the_demo_is_what_the_example_is() -> None:
    """`make demo` sets up a virtual environment, so it is not run here; it runs examples/demo.py."""
    assert section(PAGE, NOTHING).strip().startswith("make demo")
    assert "examples/demo.py --output demo_output" in (ROOT / "Makefile").read_text()
