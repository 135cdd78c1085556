"""Long jobs on a real cluster of two worker processes: what is written is what one process writes."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from command_line import CommandLine

pytest.importorskip("distributed", reason="clusters need distributed: pip install 'gpcorrect[cluster]'")
pytestmark = pytest.mark.slow

NOMINAL = """
arm = "joints"
joints = [1]
joint_types = "R"
log_rate_hz = 20.0

[noise]
external_jp_white = [1e-3]
external_jp_ar_std = [5e-4]
"""
SPEC = """
model = "nominal.toml"
seed = 12

[motion]
trajectories = 9
seconds = 4.0

[draw]
cases = 2
effect_to_noise = [2.0]
"""


def test_blind_cases_are_the_same_from_a_cluster(gpcorrect: CommandLine, tmp_path: Path, cluster: Any) -> None:
    """The sealed hash covers every log and label: it is the same."""
    (tmp_path / "nominal.toml").write_text(NOMINAL)
    (tmp_path / "spec.toml").write_text(SPEC)
    words = ("discrepancy", "generate", "--spec", tmp_path / "spec.toml", "--json", "--output")
    here = gpcorrect(*words, tmp_path / "here").json
    spread = gpcorrect(*words, tmp_path / "spread", "--scheduler", cluster.scheduler_address).json
    assert spread["sha256"] == here["sha256"]


def test_a_run_is_the_same_from_a_cluster_that_loses_a_worker(
    gpcorrect: CommandLine, tmp_path: Path, cluster: Any
) -> None:
    """Verdict, effects with their numbers, and gaps: equal, though a worker is killed as soon as the work has begun."""
    (tmp_path / "nominal.toml").write_text(NOMINAL)
    (tmp_path / "spec.toml").write_text(SPEC.replace("cases = 2", "cases = 1"))
    assert gpcorrect("discrepancy", "generate", "--spec", tmp_path / "spec.toml", "--output", tmp_path).code == 0
    words = ("discrepancy", "run", "--model", tmp_path / "nominal.toml", "--log", tmp_path / "case_000.parquet")
    pids = [nanny.pid for nanny in cluster.workers.values()]
    killed = threading.Event()

    def kill() -> None:
        while not any(w.processing for w in list(cluster.scheduler.workers.values())):
            time.sleep(0.005)
        os.kill(pids[0], signal.SIGKILL)
        killed.set()

    threading.Thread(target=kill, daemon=True).start()
    for folder, more in (("here", ()), ("spread", ("--scheduler", cluster.scheduler_address))):
        assert gpcorrect(*words, "--output", tmp_path / folder, *more).code == 0
    assert killed.is_set()
    here, spread = (json.loads((tmp_path / f / "report.json").read_text()) for f in ("here", "spread"))
    assert here.pop("provenance")["seconds"] > 0  # seconds alone differ
    spread.pop("provenance")
    assert spread == here
