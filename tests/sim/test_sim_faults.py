import numpy as np
import pytest

from gpcorrect import se3
from gpcorrect.sim import Fault, TrackerFaults
from gpcorrect.sim.record import corrupted

N, RATE = 20000, 100.0
ALL = TrackerFaults(lost_share=0.03, jumps_hz=0.5, outlier_share=0.01, flip_share=0.005, dropout_share=0.01)


def poses(n=N, seed=0):
    rng = np.random.default_rng(seed)
    return se3.pose(se3.matrix_from_rotvec(rng.standard_normal((n, 3))), rng.standard_normal((n, 3)))


def failed(faults, seed=1):
    T = poses()
    bad, code = corrupted(T, RATE, faults, np.random.default_rng(seed))
    shift = np.linalg.norm(bad[:, :3, 3] - T[:, :3, 3], axis=1)
    turn = se3.angle(np.swapaxes(T[:, :3, :3], 1, 2) @ bad[:, :3, :3])
    return T, bad, code, shift, turn


def test_good_samples_are_untouched_and_bad_ones_are_not():
    """The truth column tells exactly which samples were changed."""
    T, bad, code, _, _ = failed(ALL)
    changed = ~(bad == T).all(axis=(1, 2))
    np.testing.assert_array_equal(changed, code != Fault.GOOD)


def test_each_fault_is_as_frequent_as_asked():
    _, _, code, _, _ = failed(ALL)
    fraction = [(code == fault).mean() for fault in (Fault.LOST_FIDUCIAL, Fault.OUTLIER, Fault.FLIP, Fault.DROPOUT)]
    np.testing.assert_allclose(fraction, [0.03, 0.01, 0.005, 0.01], rtol=0.35)
    assert (code == Fault.OCCLUSION_JUMP).mean() == pytest.approx(0.5 * 0.08, rel=0.35)


def test_a_lost_fiducial_is_one_block_of_one_constant_error():
    """The block is unbroken, and its poses are all off by the same distance and turn."""
    _, _, code, shift, turn = failed(ALL)
    rows = np.flatnonzero(code == Fault.LOST_FIDUCIAL)
    assert len(rows) == round(0.03 * N)
    assert np.ptp(rows) == len(rows) - 1
    np.testing.assert_allclose(shift[rows], 0.05)
    np.testing.assert_allclose(turn[rows], 0.7)


def test_jumps_are_steps():
    """Inside an occlusion the error is constant; its size is half to one and a half times the asked one."""
    _, _, code, shift, _ = failed(TrackerFaults(jumps_hz=0.5))
    inside = code == Fault.OCCLUSION_JUMP
    assert ((shift[inside] >= 0.015 - 1e-12) & (shift[inside] <= 0.045 + 1e-12)).all()
    steps = np.abs(np.diff(shift))[inside[1:] & inside[:-1]]
    assert (steps < 1e-12).mean() > 0.9


def test_flips_are_half_turns_in_place():
    _, _, code, shift, turn = failed(TrackerFaults(flip_share=0.01))
    np.testing.assert_allclose(turn[code == Fault.FLIP], np.pi)
    np.testing.assert_allclose(shift[code == Fault.FLIP], 0.0)
