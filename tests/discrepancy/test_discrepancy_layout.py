"""Recordings laid side by side: how they are cut must not matter."""

from __future__ import annotations

import numpy as np
import pytest

from gpcorrect.discrepancy.recording import scene as scenes
from gpcorrect.discrepancy.recording.layout import layout_of
from gpcorrect.sim import model_from_dict
from gpcorrect.sim.effects import effect_from_dict
from gpcorrect.types import CalibrationLog, FloatArray

RAVEN = {
    "arm": "raven2_left",
    "joints": [1, 2, 3],
    "controller": {"kp": [300.0, 300.0, 3000.0], "kd": [15.0, 15.0, 150.0], "feedforward": "rigid-body"},
    "transmission": {"motor_inertia": [0.3, 0.3, 2.0]},
}


ALIKE = np.repeat(np.arange(4), 2000)  # whole motions pad nothing, pieces would repeat their warm-ups
ONE_LONG = np.repeat(np.arange(21), [6000, *[100] * 20])  # whole motions would be padded to the long one


def test_every_row_stands_once_among_the_valid_ones() -> None:
    """Pieces with warm-up and run-out hold each row of each label exactly once, and rows without a label never."""
    label = np.repeat([0, -1, 1, 2], [500, 5, 7, 9])
    layout = layout_of(label, piece=10, warm_up=20, run_out=4)
    assert sorted(layout.rows[layout.valid].tolist()) == np.flatnonzero(label >= 0).tolist()


def test_the_smaller_grid_is_taken() -> None:
    """Motions of one length stay whole; one long motion among short ones is cut, each piece after its warm-up."""
    assert layout_of(ALIKE, piece=200, warm_up=400).rows.shape == (2000, 4)
    cut = layout_of(ONE_LONG, piece=200, warm_up=400, run_out=40)
    assert cut.rows.shape == (640, 30 + 20)
    assert cut.rows.size < layout_of(ONE_LONG).rows.size
    np.testing.assert_array_equal(cut.rows[cut.valid[:, 5], 5], np.arange(1000, 1200))
    assert (cut.rows[0, 5], cut.rows[-1, 5]) == (600, 1239)


@pytest.mark.parametrize(
    "effect", [{"name": "cable_stretch", "stiffness": 300.0}, {"name": "viscous_friction", "damping": 2.0}]
)
def test_a_recording_replayed_in_pieces_says_what_it_says_in_one(
    effect: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cutting a motion does not look like stopping it: signatures agree within a hundredth of their size."""
    change = [_signature(piece, effect, monkeypatch) for piece in (10_000, 200)]
    assert np.abs(change[0]).max() > 1e-4
    assert np.abs(change[1] - change[0]).max() < 0.01 * np.abs(change[0]).max()


def _signature(piece: int, effect: dict[str, object], monkeypatch: pytest.MonkeyPatch) -> FloatArray:
    monkeypatch.setattr(scenes, "PIECE", piece)
    log = _moving()
    scene = scenes.build_scene(log, model_from_dict(RAVEN), np.ones(len(log), dtype=np.bool_))
    assert scene.layout.rows.shape[1] == (14 if piece == 200 else 9)
    missing = effect_from_dict({"joint": 2, **effect})
    change: FloatArray = scene.predict([missing]) - scene.predict()
    return change


def _moving() -> CalibrationLog:
    """Twelve seconds of one motion that never rests, and eight of one second, seen from outside."""
    number = np.repeat(np.arange(9), [1200, *[100] * 8])
    t = np.arange(len(number)) / 100.0 + 10.0 * number
    phase = t[:, None] * np.array([1.1, 1.7, 2.3]) + np.array([0.3, 1.0, 2.0])
    q = np.array([0.6, 1.6, 0.32]) + np.array([0.3, 0.3, 0.06]) * np.sin(phase)
    return CalibrationLog(
        time=t,
        trajectory=number,
        session=np.zeros(len(t), dtype=np.int64),
        setpoint_jp=q,
        measured_jp=q,
        external_jp=q,
    )
