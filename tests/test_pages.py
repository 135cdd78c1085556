"""Blocks of other documents than the newcomer's page, each line run as it stands where its files can be made."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from joint_logs import joint_log
from shown import run_shown, section
from support import ROOT, small_log

from gpcorrect.calibration import FitSettings, ModelStore, fit_corrector, save
from gpcorrect.logs import write_log

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("bash") is None, reason="the pages' lines are for a shell: bash is not installed"),
]


def models(folder: Path, small_model: Path) -> None:
    """Files and a store of models as the pages name them."""
    for name in ("model.gpc", "monday.gpc", "tuesday.gpc"):
        shutil.copyfile(small_model, folder / name)
    store = ModelStore(folder / "models")
    store.add(small_model, now=0.0, name="tuesday")


def test_what_a_model_remembers(tmp_path: Path, small_model: Path) -> None:
    """The block of docs/models.md: info, list and diff; the list names what the store holds."""
    models(tmp_path, small_model)
    info, listed, diff = run_shown((ROOT / "docs/models.md").read_text(), tmp_path)
    assert "held out" in info.printed
    assert "tuesday" in listed.printed
    assert "both say the same of themselves" in diff.printed


def test_models_that_change_while_serving(tmp_path: Path, small_model: Path, ports: None) -> None:
    """The block of docs/service.md, with a running server that is told to change its model."""
    models(tmp_path, small_model)
    settings = FitSettings(marker="none", time_offset="none", search_samples=100)
    save(fit_corrector(small_log(seed=5), settings), tmp_path / "model.gpc")
    *_, told, diff, listed, back = run_shown(section("docs/service.md", "Models that change"), tmp_path)
    assert "before" in told.printed
    assert "commands apart" in diff.printed
    assert "monday" in listed.printed
    assert "monday" in back.printed


def test_metrics_for_prometheus(tmp_path: Path, small_model: Path, ports: None) -> None:
    """The block of docs/service.md: curl reads the state of the server."""
    if shutil.which("curl") is None:
        pytest.skip("curl is not installed")
    models(tmp_path, small_model)
    _, scraped = run_shown(section("docs/service.md", "Metrics"), tmp_path)
    assert 'gpcorrect_state{state="ENABLED"} 1.0' in scraped.printed


def weeks(folder: Path) -> None:
    """Write recordings as docs/adaptation.md names them."""
    for number, name in enumerate(("tuesday", "week1", "week2", "week3", "suturing")):
        write_log(small_log(number, 6), folder / f"{name}.csv")


def joints(folder: Path) -> None:
    """Write recordings as docs/joint.md names them."""
    names = ("LOG", "OTHER", "MINUTE", "MONDAY", "TUESDAY")
    for number, name in enumerate(names):
        write_log(joint_log(number + 1, trajectories=5, seconds=12.0), folder / f"{name}.csv")


@pytest.mark.parametrize(
    ("page", "given", "left_out"),
    [
        ("docs/adaptation.md", weeks, ()),
        # Whole studies, and a fit of every method: they have tests of their own.
        ("docs/joint.md", joints, ("gpcorrect reproduce", "gpcorrect joint compare")),
    ],
)
def test_a_page_runs_as_it_stands(
    page: str, given: Callable[[Path], None], left_out: tuple[str, ...], tmp_path: Path, small_model: Path
) -> None:
    """Every command of the page ends well on recordings of the names that it shows."""
    models(tmp_path, small_model)
    given(tmp_path)
    lines = (ROOT / page).read_text().splitlines(keepends=True)
    text = "".join(line for line in lines if not line.strip().startswith(left_out or ("\0",)))
    assert run_shown(text, tmp_path)
