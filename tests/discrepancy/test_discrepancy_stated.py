"""Noise that the model states is what counts, unless the recording is clearly noisier."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.discrepancy_core import NOISE, joint_log
from discrepancy.discrepancy_support import nominal
from scipy.signal import lfilter

from gpcorrect.discrepancy import find_discrepancy
from gpcorrect.discrepancy.evidence.whitener import estimate_noises
from gpcorrect.discrepancy.recording.noise import ChannelNoise, NoiseSource
from gpcorrect.discrepancy.recording.stated_noise import averaged, rounded_to
from gpcorrect.discrepancy.search.prepared import prepare_data
from gpcorrect.sim import Noise
from gpcorrect.types import CalibrationLog, FloatArray


def noises(noise: Noise | None) -> tuple[ChannelNoise, ...]:
    model = nominal().model_copy(update={"noise": noise})
    dataset = prepare_data(joint_log(3), model, np.random.default_rng(0)).dataset
    return estimate_noises(dataset, dataset.residual(), dataset.training)


def test_stated_noise_is_used() -> None:
    """White and slow part are those of the model file; the time constant is that of its correlation."""
    stated = Noise(external_jp_white=(NOISE, 2 * NOISE), external_jp_ar_std=(5e-4, 5e-4), external_jp_ar_phi=0.9)
    first, second = noises(stated)
    assert first.source == second.source == NoiseSource.STATED
    assert first.white == pytest.approx(NOISE)
    assert second.white == pytest.approx(2 * NOISE)
    assert first.time_constant == pytest.approx(-0.05 / np.log(0.9))


def test_noise_that_is_not_stated_is_estimated() -> None:
    """Without a table, the noise comes from the recording and says so."""
    for noise in noises(None):
        assert noise.source != NoiseSource.STATED
        assert noise.std == pytest.approx(NOISE, rel=0.25)


def test_too_small_a_noise_is_not_believed() -> None:
    """A stated noise far below the recording's would give names to noise: the recording's is taken, and said so."""
    for noise in noises(Noise(external_jp_white=(1e-5, 1e-5))):
        assert noise.times_stated == pytest.approx(NOISE / 1e-5, rel=0.25)
        assert noise.std == pytest.approx(NOISE, rel=0.25)


def test_a_coarse_sensor_is_not_silent_because_it_stands_still() -> None:
    """Rounding makes an error of its step over the root of twelve; a finer step changes nothing."""
    still = ChannelNoise(1e-9, 0.0, 1.0)
    coarse = rounded_to(still, 1e-3, still)
    assert coarse.std == pytest.approx(1e-3 / np.sqrt(12))
    assert coarse.rounding_step == 1e-3
    assert rounded_to(coarse, 1e-4, still) is coarse


def at_20_hz(q: FloatArray, seen: FloatArray, trajectories: int) -> CalibrationLog:
    """Return a recording of motors and of what was seen of the joints, ten seconds between its motions."""
    number = np.repeat(np.arange(trajectories), len(q) // trajectories)
    return CalibrationLog(
        time=np.arange(len(q)) / 20.0 + 10.0 * number,
        trajectory=number,
        session=np.zeros_like(number),
        measured_jp=q,
        external_jp=seen,
    )


def test_a_recording_in_coarse_steps_has_the_noise_of_its_steps() -> None:
    log = joint_log(3)
    step = 8 * NOISE
    rounded = replace(log, external_jp=np.round(log.external_jp / step) * step)
    dataset = prepare_data(rounded, nominal(), np.random.default_rng(0)).dataset
    assert dataset.resolution == pytest.approx([step, step], rel=1e-3)
    assert all(
        n.std >= 0.99 * step / np.sqrt(12) for n in estimate_noises(dataset, dataset.residual(), dataset.training)
    )
    fine = prepare_data(log, nominal(), np.random.default_rng(0)).dataset
    assert fine.resolution == pytest.approx([0.0, 0.0])


def test_steps_hide_in_holds_what_they_do_not_while_joints_move() -> None:
    """Noise of a quarter of a step leaves most holds at one count: left out of account, it was a find."""
    rng, step, trajectories, samples = np.random.default_rng(5), 2e-4, 12, 400
    t, phase = np.arange(samples)[:, None] / 20.0, np.linspace(0.0, 6.0, trajectories)[:, None, None]
    q = np.concatenate(0.5 * np.clip(1.4 * np.sin(t * [0.9, 1.1] + phase), -1.0, 1.0))
    seen = np.round((q + 0.25 * step * rng.standard_normal(q.shape)) / step) * step
    log = at_20_hz(q, seen, trajectories)
    dataset = prepare_data(log, nominal().model_copy(update={"noise": None}), rng).dataset
    assert dataset.still.sum() > 1000
    assert dataset.good.all()  # a step more than the neighbours is no fault of the sensor
    for error, noise in zip((seen - q).T, estimate_noises(dataset, dataset.residual(), dataset.training), strict=True):
        assert noise.std == pytest.approx(error.std(), rel=0.05)


def test_averaged_noise_is_that_of_means() -> None:
    """White and slow part of means over neighbouring samples agree with simulated ones."""
    rng, phi, count = np.random.default_rng(0), 0.95, 5
    slow = lfilter([np.sqrt(1 - phi**2)], [1.0, -phi], rng.standard_normal(400_000))
    single = ChannelNoise(0.8, 1.0, -0.01 / np.log(phi))
    mean = averaged(single, count, 0.01)
    assert mean.white == pytest.approx(0.8 / np.sqrt(count))
    assert mean.slow == pytest.approx(slow.reshape(-1, count).mean(axis=1).std(), rel=0.03)


def test_what_an_outside_sensor_rounds_adds_to_the_noise_that_is_stated() -> None:
    """A count of twice the stated noise shows in the values: that the sensor is noisier by it is no discrepancy."""
    rng, step, trajectories, samples = np.random.default_rng(7), 2e-4, 12, 400
    t, phase = np.arange(samples)[:, None] / 20.0, np.linspace(0.0, 6.0, trajectories)[:, None, None]
    q = np.concatenate(0.5 * np.sin(t * [0.9, 1.1] + phase))
    seen = np.round((q + 0.4 * step * rng.standard_normal(q.shape)) / step) * step
    log = at_20_hz(q, seen, trajectories)
    model = nominal().model_copy(update={"noise": Noise(external_jp_white=(0.4 * step, 0.4 * step))})
    dataset = prepare_data(log, model, rng).dataset
    for error, noise in zip((seen - q).T, estimate_noises(dataset, dataset.residual(), dataset.training), strict=True):
        assert noise.source == NoiseSource.STATED
        assert noise.std == pytest.approx(error.std(), rel=0.05)
    assert find_discrepancy(model, log).level == "NONE"
