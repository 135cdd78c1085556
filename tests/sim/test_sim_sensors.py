from dataclasses import replace

import numpy as np
import pytest
from sim_machines import drive, moves, raven

from gpcorrect import se3
from gpcorrect.sim import Noise, simulate
from gpcorrect.sim.sensors import ar_noise


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.95])
def test_ar_noise_has_its_deviation_and_correlation_from_the_first_sample_on(phi):
    """The AR part is stationary: the same deviation at both ends, and the asked correlation between neighbours."""
    noise = ar_noise(np.random.default_rng(0), (40, 20000), 0.0, 2.0, phi)
    np.testing.assert_allclose(noise.std(axis=1), 2.0, rtol=0.03)
    np.testing.assert_allclose((noise[:-1] * noise[1:]).mean(axis=1) / 4.0, phi, atol=0.05)


def test_white_and_ar_variances_add_up():
    noise = ar_noise(np.random.default_rng(1), (200, 2000), 3.0, 4.0, 0.9)
    assert noise.std() == pytest.approx(5.0, rel=0.02)


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
