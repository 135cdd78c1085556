"""The operator's commands: models of a store, and the doctor."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import CommandLine
from service_support import PATIENT, endpoint_of, free_port, store_process

from gpcorrect.calibration import FitSettings, JointCorrector, ModelStore, fit_model, load_any, save
from gpcorrect.types import CalibrationLog, LogMeta
from gpcorrect_service import CorrectionClient
from gpcorrect_service.server.models import load_joint_model

Run = Callable[..., tuple[int, str]]


@pytest.fixture
def run(gpcorrect: CommandLine) -> Run:
    """Call `gpcorrect` with words; its exit status and all it printed."""

    def call(*words: object) -> tuple[int, str]:
        outcome = gpcorrect(*words)
        return outcome.code, outcome.out + outcome.err

    return call


@pytest.fixture
def store(tmp_path: Path, model_files: tuple[Path, Path], run: Run) -> Path:
    """Fill a store by command."""
    folder = tmp_path / "store"
    for path in model_files:
        assert run("models", "add", path, "--store", folder)[0] == 0
    return folder


def listed(run: Run, *place: object) -> list[dict[str, Any]]:
    code, text = run("models", "list", *place, "--json")
    assert code == 0
    rows: list[dict[str, Any]] = json.loads(text)
    return rows


def test_a_store_by_command(store: Path, run: Run) -> None:
    """Added models are listed; activate, diff and rollback do as they say; an unknown name ends with status 2."""
    assert [row["id"] for row in listed(run, "--store", store)] == ["monday", "tuesday"]
    for name in ("monday", "tuesday"):
        assert run("models", "activate", name, "--store", store)[0] == 0
    assert [row["active"] for row in listed(run, "--store", store)] == [False, True]
    code, text = run("models", "diff", "monday", "tuesday", "--store", store, "--json")
    assert code == 0
    assert json.loads(text)["commands"]["max_mm"] > 0
    files = [folder.path(folder.find(name)) for folder in [ModelStore(store)] for name in ("monday", "tuesday")]
    assert json.loads(run("models", "diff", *files, "--json")[1]) == json.loads(text)
    code, text = run("models", "diff", "monday", "tuesday", "--store", store)
    assert (code, len(text.splitlines()) < 13) == (0, True)
    assert "monday" in run("models", "rollback", "--store", store)[1]
    code, text = run("models", "activate", "sunday", "--store", store)
    assert (code, "monday" in text) == (2, True)


def test_an_activation_says_how_far_commands_move(store: Path, run: Run) -> None:
    """A model of another frame, a metre away, was activated without a word, in a folder and in servers."""
    files = [folder.path(folder.find(name)) for folder in [ModelStore(store)] for name in ("monday", "tuesday")]
    apart = json.loads(run("models", "diff", *files, "--json")[1])["commands"]
    says = f"commands lie up to {apart['max_mm']:.3g} mm and {apart['max_deg']:.3g} deg from the former's"
    assert run("models", "activate", "monday", "--store", store)[0] == 0
    assert says in " ".join(run("models", "activate", "tuesday", "--store", store)[1].split())
    code, text = run("models", "rollback", "--store", store, "--json")
    assert (code, json.loads(text)["apart_mm"]) == (0, apart["max_mm"])
    with store_process(store) as server:
        place = ("--endpoint", server.endpoint)
        assert says in " ".join(run("models", "activate", "tuesday", *place)[1].split())


def test_running_servers_by_command(store: Path, run: Run) -> None:
    """With an address, the running server lists, activates, goes back, pauses; the doctor calls it well."""
    folder = ModelStore(store)
    folder.activate(folder.find("monday"))
    with store_process(store) as server:
        place = ("--endpoint", server.endpoint)
        assert "tuesday" in run("models", "activate", "tuesday", *place)[1]
        rows = listed(run, *place)
        assert {row["id"]: row["active"] for row in rows} == {"monday": False, "tuesday": True}
        stored = {row["id"]: (row["made"], row["held_out"]) for row in listed(run, "--store", store)}
        assert {row["id"]: (row["made"], row["held_out"]) for row in rows} == stored
        assert all(made for made, _ in stored.values())
        assert "monday" in run("models", "rollback", *place)[1]
        assert "PAUSED" in run("models", "state", "PAUSED", *place)[1]
        assert "gpcorrect_state" in run("query", "metrics", *place, "--timeout", PATIENT)[1]
        code, text = run("doctor", *place, "--arm", "PSM1")
        assert (code, "other arms here: --arm arm1" in " ".join(text.split())) == (1, True)
        code, text = run("doctor", *place, "--json")
    assert (code, [step["well"] for step in json.loads(text)]) == (0, [True] * len(json.loads(text)))


def test_the_doctor_by_command(run: Run) -> None:
    """Where nobody listens the doctor says so and ends with status 1."""
    code, text = run("doctor", "--endpoint", endpoint_of(free_port()))
    assert (code, "closed port" in text) == (1, True)


def test_no_place_is_named(run: Run) -> None:
    """Without folder and address a command says which to give."""
    code, text = run("models", "list")
    assert (code, "--store" in text) == (2, True)


def test_joint_models_are_stored_and_served_too(tmp_path: Path, run: Run) -> None:
    """A joint calibration is recognised by its file, and its live path answers what it learned: here an offset."""
    rng = np.random.default_rng(0)
    time = 0.1 * np.arange(400)
    q = np.array([0.3, 0.3, 0.05]) * np.sin(time[:, None] * np.array([0.7, 0.9, 1.1]))
    log = CalibrationLog(
        time=time,
        trajectory=np.arange(400) // 100,
        session=np.zeros(400),
        measured_jp=q,
        external_jp=q + np.array([0.01, -0.02, 0.003]) + 1e-5 * rng.standard_normal(q.shape),
        meta=LogMeta(joint_types="RRP"),
    )
    path = tmp_path / "joints.gpc"
    save(fit_model(log, FitSettings(method="offset", time_offset="none"), task=JointCorrector).corrector, path)
    assert load_any(path).TASK == "joints"
    assert run("models", "add", path, "--store", tmp_path / "store")[0] == 0
    code, text = run("serve", path)
    assert (code, "gpcorrect serve --joints" in text) == (2, True)  # which of the two options it belongs to
    model = load_joint_model(path)
    answer = model.corrector.stream().correct(1.0, np.array([0.1, 0.1, 0.02]))
    np.testing.assert_allclose(answer.joints, [0.11, 0.08, 0.023], atol=1e-4)
    assert model.corrector.types == "RRP"


def test_a_server_whose_log_finds_no_room_answers(model_files: tuple[Path, Path]) -> None:
    """`gpcorrect serve` starts, and answers, where standard error is on a full disk."""
    endpoint = endpoint_of(free_port())
    command = [sys.executable, "-m", "gpcorrect", "serve", str(model_files[0]), "--endpoint", endpoint]
    with (
        Path("/dev/full").open("wb", buffering=0) as full,
        subprocess.Popen(command, stdout=full, stderr=full) as process,
        CorrectionClient(endpoint, timeout=PATIENT, connect_timeout=PATIENT) as client,
    ):
        try:
            assert client.health().state == "ENABLED"
        finally:
            process.kill()


def test_going_back_twice_goes_back_twice(store: Path, model_files: tuple[Path, Path], run: Run) -> None:
    """A model that was given up does not come back: not in a running server, not in the folder that it shares."""
    folder = ModelStore(store)
    oldest = with_words(model_files[0], store.parent / "sunday.gpc", robot="")
    assert run("models", "add", oldest, "--store", store)[0] == 0
    for name in ("sunday", "monday", "tuesday"):
        folder.activate(folder.find(name))
    with store_process(store) as server:
        place = ("--endpoint", server.endpoint)
        assert "pose monday" in run("models", "rollback", *place)[1]
        assert "pose sunday" in run("models", "rollback", *place)[1]
        assert run("models", "rollback", *place)[0] == 2
    assert [entry.id for entry in folder.history()] == ["sunday"]


def test_a_model_of_another_arm_is_activated_nowhere(store: Path, model_files: tuple[Path, Path], run: Run) -> None:
    """Neither in the folder nor at a server's start, nor beside another arm's, nor before a sister's commands."""
    one, other = (with_words(model_files[0], store.parent / f"{arm}.gpc", arm=arm) for arm in ("PSM1", "PSM2"))
    for path in (one, other):
        assert run("models", "add", path, "--store", store)[0] == 0
    assert run("models", "activate", "PSM1", "--store", store)[0] == 0
    code, text = run("models", "activate", "PSM2", "--store", store)
    assert (code, "has arm PSM2, the active model PSM1" in text) == (2, True)
    for words in (("serve", other), ("prefilter", other), ("serve", "--store", store)):
        code, text = run(*words, "--arm", "PSM2" if words[-1] == store else "PSM1")
        assert (code, "was learned on" in text) == (2, True), text


def with_words(model: Path, path: Path, **words: str) -> Path:
    """Write a model again that says something else of itself."""
    corrector = load_any(model)
    save(replace(corrector, summary={**corrector.summary, **words}), path)
    return path
