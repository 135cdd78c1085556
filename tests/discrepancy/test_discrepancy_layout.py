"""Recordings prepared side by side: how they are cut must not matter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gpcorrect.discrepancy.recording import build
from gpcorrect.discrepancy.recording.layout import layout_of
from gpcorrect.sim import model_from_dict
from gpcorrect.sim.effects import effect_from_dict
from gpcorrect.types import CalibrationLog, FloatArray

ALIKE = np.repeat(np.arange(4), 2000)  # whole motions pad nothing, pieces would repeat their warm-ups
ONE_LONG = np.repeat(np.arange(21), [6000, *[100] * 20])  # whole motions would be padded to the long one
RAVEN = {
    "arm": "raven2_left",
    "joints": [1, 2, 3],
    "controller": {"kp": [300.0, 300.0, 3000.0], "kd": [15.0, 15.0, 150.0], "feedforward": "rigid-body"},
    "transmission": {"motor_inertia": [0.3, 0.3, 2.0]},
}


@pytest.mark.parametrize("label", [ALIKE, ONE_LONG], ids=["alike", "one long"])
def test_every_row_comes_back(label: np.ndarray) -> None:
    """What is spread over the grid is gathered again, row by row."""
    layout, values = layout_of(label, piece=200, warm_up=400, run_out=40), np.arange(float(len(label)))
    np.testing.assert_array_equal(layout.gather(layout.spread(values)), values)


def test_the_smaller_grid_is_taken() -> None:
    """Motions of one length stay whole; one long motion among short ones is cut, each piece after its warm-up."""
    assert layout_of(ALIKE, piece=200, warm_up=400, run_out=0).rows.shape == (2000, 4)
    cut = layout_of(ONE_LONG, piece=200, warm_up=400, run_out=0)
    assert cut.rows.shape == (600, 30 + 20)
    assert cut.rows.size < layout_of(ONE_LONG, piece=6000, warm_up=400, run_out=0).rows.size
    np.testing.assert_array_equal(cut.rows[cut.valid[:, 5], 5], np.arange(1000, 1200))
    assert cut.rows[0, 5] == 600


@pytest.mark.parametrize(
    "effect", [{"name": "cable_stretch", "stiffness": 300.0}, {"name": "viscous_friction", "damping": 2.0}]
)
def test_a_recording_replayed_in_pieces_says_what_it_says_in_one(
    effect: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cutting a motion does not look like stopping it: signatures agree within a hundredth of their size."""
    change = [_signature(piece, effect, monkeypatch) for piece in (10_000, 200)]
    assert np.abs(change[0]).max() > 1e-4
    assert np.abs(change[1] - change[0])[:1200].max() < 0.01 * np.abs(change[0]).max()


def _signature(piece: int, effect: dict[str, object], monkeypatch: pytest.MonkeyPatch) -> FloatArray:
    monkeypatch.setattr(build, "PIECE", piece)
    log = _moving()
    scene = build.build_scene(log, model_from_dict(RAVEN), np.ones(len(log), dtype=np.bool_))
    missing = effect_from_dict({"joint": 2, **effect})
    change: FloatArray = scene.predict([missing]) - scene.predict()
    return change


def _moving() -> CalibrationLog:
    """Twelve seconds of one motion that never rests, and thirty of one second each, seen from outside."""
    trajectory = np.repeat(np.arange(31), [1200, *[100] * 30])
    t = np.arange(len(trajectory)) / 100.0
    phase = t[:, None] * np.array([1.1, 1.7, 2.3]) + np.array([0.3, 1.0, 2.0])
    q = np.array([0.6, 1.6, 0.32]) + np.array([0.3, 0.3, 0.06]) * np.sin(phase)
    session = np.zeros(len(t), dtype=np.int64)
    return CalibrationLog(time=t, trajectory=trajectory, session=session, setpoint_jp=q, measured_jp=q, external_jp=q)


@pytest.mark.filterwarnings("ignore:(divide by zero|invalid value) encountered:RuntimeWarning")  # speeds of no time
@pytest.mark.parametrize("held", [3, 600], ids=["most steps", "all"])
def test_no_loop_is_run_on_a_clock_that_stands_still(held: int) -> None:
    """Stamps that come several times, or are all one, are no steps of a servo loop: it is not run, which is said."""
    log, model = _moving().select(slice(0, 600)), model_from_dict(RAVEN)
    still = replace(log, time=log.time[np.arange(600) // held * held])
    running, standing = (build.build_scene(each, model, np.ones(600, dtype=np.bool_)) for each in (log, still))
    assert running.plan is not None
    assert standing.plan is None
    assert any("the closed loop is not run" in remark for remark in standing.remarks)
