from dataclasses import replace

import numpy as np
import pytest
from sim_machines import drive, moves, raven

from gpcorrect import se3
from gpcorrect.sim import Noise, simulate
from gpcorrect.sim.sensors import SensorNoise


def drawn(seed, samples, runs, white, slow, phi):
    """Return noise of one sensor on N runs `(n, N)`, at 100 Hz."""
    time = np.arange(samples)[:, None] / 100.0 + np.zeros(runs)
    return SensorNoise(np.random.default_rng(seed), white, slow, phi, 100.0).draw(time, 1)[..., 0]


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.95])
def test_slow_noise_has_its_deviation_and_correlation_from_the_first_sample_on(phi):
    """The slow part is stationary: the same deviation at both ends, and the asked correlation between neighbours."""
    noise = drawn(0, 40, 20000, 0.0, 2.0, phi)
    np.testing.assert_allclose(noise.std(axis=1), 2.0, rtol=0.03)
    np.testing.assert_allclose((noise[:-1] * noise[1:]).mean(axis=1) / 4.0, phi, atol=0.05)


def test_white_and_slow_variances_add_up():
    """Independent parts of deviation 3 and 4 give a deviation of 5."""
    assert drawn(1, 200, 2000, 3.0, 4.0, 0.9).std() == pytest.approx(5.0, rel=0.02)


def test_slow_noise_is_the_same_in_stretches():
    """Cut into stretches, or asked one sample at a time, the same draws give the same noise."""
    time = np.arange(50)[:, None] / 100.0
    whole = SensorNoise(np.random.default_rng(3), 0.0, 2.0, 0.95, 100.0).draw(time, 1)

    class Replayed:
        """Gives the slow part's draws one after the other, and no white ones."""

        def __init__(self):
            self.fresh = np.random.default_rng(3).standard_normal((50, 1, 1))
            self.calls = 0

        def standard_normal(self, shape):
            self.calls += 1
            if self.calls % 2 == 0:
                return np.zeros(shape)
            taken, self.fresh = self.fresh[: shape[0]], self.fresh[shape[0] :]
            return taken

    noise = SensorNoise(Replayed(), 0.0, 2.0, 0.95, 100.0)
    parts = [noise.draw(time[a:b], 1) for a, b in [(0, 1), (1, 2), (2, 30), (30, 50)]]
    np.testing.assert_allclose(np.concatenate(parts), whole, atol=1e-12)


@pytest.mark.parametrize("gap", [0.0, 0.01, 0.3])
def test_slow_noise_forgets_by_the_time_that_passes(gap):
    """Asked again after any time, its correlation has fallen by phi for each log sample that would have passed."""
    time = np.zeros((1, 40000))
    noise = SensorNoise(np.random.default_rng(2), 0.0, 1.0, 0.95, 100.0)
    before, after = noise.draw(time, 1), noise.draw(time + gap, 1)
    assert np.corrcoef(before.ravel(), after.ravel())[0, 1] == pytest.approx(0.95 ** (100.0 * gap), abs=0.02)


def test_noise_of_the_log_is_the_asked_one():
    """Outside joints and tracker differ from a noiseless recording by the deviations of the model."""
    plan = moves(runs=8)
    quiet = raven(drive=drive("gravity"))
    noise = Noise(
        external_jp_white=(1e-3, 2e-3, 1e-4), tracker_white=3e-4, tracker_ar_std=4e-4, tracker_rotation_white=2e-3
    )
    clean, noisy = simulate(quiet, plan), simulate(replace(quiet, noise=noise), plan)
    np.testing.assert_allclose((noisy.external_jp - clean.external_jp).std(axis=0), [1e-3, 2e-3, 1e-4], rtol=0.05)
    shift = noisy.tracker_cp.position - clean.tracker_cp.position
    np.testing.assert_allclose(shift.std(axis=0), 5e-4, rtol=0.1)
    T = [se3.matrix_from_quaternion(log.tracker_cp.quaternion) for log in (clean, noisy)]
    turn = se3.rotvec_from_matrix(np.swapaxes(T[0], 1, 2) @ T[1])
    np.testing.assert_allclose(turn.std(axis=0), 2e-3, rtol=0.05)
    np.testing.assert_array_equal(noisy.measured_jp, clean.measured_jp)


def test_encoders_report_whole_steps():
    """A quantised reading is a multiple of the step, and half a step away at most; a step of zero is none."""
    plan, machine = moves(runs=1), raven(drive=drive("gravity"))
    steps = np.array([0.01, 0.0, 1e-4])
    fine = simulate(machine, plan).measured_jp
    coarse = simulate(replace(machine, noise=Noise(encoder_step=tuple(steps))), plan).measured_jp
    assert (np.abs(coarse - fine) <= steps / 2 + 1e-12).all()
    counts = coarse[:, [0, 2]] / steps[[0, 2]]
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
