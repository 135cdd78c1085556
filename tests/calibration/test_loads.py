"""Another load than the training's: efforts stay in their ranges, and are not those of the motion."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine, written
from joint_logs import joint_log

from gpcorrect.calibration import FitSettings, JointCorrector, fit_model, load, save
from gpcorrect.calibration.dataset import Layout
from gpcorrect.calibration.loads import FRICTION, Loads
from gpcorrect.types import CalibrationLog


def carrying(payload: float, seed: int, shift: float = 0.0) -> CalibrationLog:
    """Return a recording whose efforts hold a payload against gravity."""
    log = joint_log(seed, trajectories=6, shift=shift)
    return replace(log, measured_jf=log.measured_jf + payload * np.sin(log.measured_jp) * np.array([0.0, 1.0, 0.0]))


@pytest.fixture(scope="module", params=["linear", "gp"])
def model(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a model of training with a payload of 1."""
    path = tmp_path_factory.mktemp("loads") / "joints.gpc"
    settings = FitSettings(method=request.param, inducing=60, search_samples=120)
    save(fit_model(carrying(1.0, 1), settings, task=JointCorrector).corrector, path)
    return path


def test_the_compiled_law_is_the_one_that_was_fitted() -> None:
    """Term by term: a stream reads the same law of second degree."""
    rng = np.random.default_rng(2)
    X, labels = rng.standard_normal((600, 5)), np.arange(600) // 50
    X[:, 4] += X[:, 0] * X[:, 1] + 0.3 * X[:, 2] ** 2
    none = np.zeros(0, dtype=np.int64)
    layout = Layout(
        (1,), None, none, None, np.zeros(5), 10, none, np.array([0, 1]), none, np.array([4]), np.array([2, 3])
    )
    loads = Loads.of(X, labels, layout)
    assert loads is not None
    speed = X[:, 2:4] / loads.usual
    motion = np.hstack([X[:, :2], speed, np.tanh(FRICTION * speed)])
    expected = (X[:, 4:] - loads.law.mean(motion)) / loads.farthest
    np.testing.assert_allclose(loads.off(X), expected, atol=1e-12)
    assert np.abs(expected).max() > 0.5


def test_under_another_load_nothing_is_known(model: Path) -> None:
    """Whole paths and streams say so alike, and a motion of the training's load is inside."""
    corrector = load(model, JointCorrector)
    inside = []
    for payload in (1.0, 1.5):
        log = carrying(payload, 2)
        whole = corrector.correct_path(log.measured_jp, log.time, log.measured_jf)
        stream, rows = corrector.stream(), range(40)
        live = [stream.correct(log.time[k], log.measured_jp[k], log.measured_jf[k]).in_domain for k in rows]
        assert live == whole.in_domain[:40].tolist()
        inside.append(whole.in_domain.mean())
    assert inside[1] < 0.1 < 0.9 < inside[0]


def test_a_load_is_not_called_a_homing(gpcorrect: CommandLine, model: Path, tmp_path: Path) -> None:
    """The same offset is a zero under the training's load, and under another one a load."""
    said = [
        gpcorrect("joint", "evaluate", model, written(carrying(p, 3, shift=0.05), tmp_path / f"{p}.csv")).said
        for p in (1.0, 1.5)
    ]
    assert "the zero of joint 2 is off" in said[0]
    assert "of the same motion in training" not in said[0]
    assert "the efforts of joint 2 are not those of the same motion in training: another load" in said[1]
    assert "joint rezero" not in said[1]


def test_an_offset_of_a_part_is_no_zero(model: Path) -> None:
    """A new zero would not mend a session that misses half of the time."""
    corrector, log = load(model, JointCorrector), carrying(1.0, 4)
    off = np.where(np.arange(len(log)) < 0.6 * len(log), 0.05, 0.0)[:, None] * np.array([0.0, 1.0, 0.0])
    log = replace(log, external_jp=log.external_jp + off)
    assert not any(row["moved"] for row in corrector.zeros(log, corrector.measure(log, np.ones(len(log), bool))))
