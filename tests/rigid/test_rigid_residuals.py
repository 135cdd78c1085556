from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rigid_planted import motion, moved, signal
from scipy.spatial.transform import Rotation

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.rigid import apply_residual, pose_residual
from gpcorrect.types import PoseSignal


def same_poses(a: PoseSignal, b: PoseSignal, atol: float) -> None:
    np.testing.assert_allclose(a.position, b.position, atol=atol)
    np.testing.assert_allclose(
        se3.matrix_from_quaternion(a.quaternion), se3.matrix_from_quaternion(b.quaternion), atol=atol
    )


@settings(deadline=None, max_examples=60)
@given(
    arrays(np.float64, (2, 3), elements=st.floats(-2, 2)),
    arrays(np.float64, (2, 3), elements=st.floats(-3.2, 3.2)),
)
def test_residual_leads_from_reference_to_command(position: np.ndarray, rotvec: np.ndarray) -> None:
    """Applying the residual of any two poses to the first gives the second."""
    turn = Rotation.from_rotvec(rotvec)
    reference, command = signal(position[:1], turn[:1]), signal(position[1:], turn[1:])
    same_poses(apply_residual(reference, pose_residual(reference, command)), command, 1e-12)


@pytest.mark.parametrize("short_of_pi", [0.0, 1e-12, 1e-8, 1e-4, -1e-4])
def test_round_trip_holds_around_half_turns(short_of_pi: float, rng: np.random.Generator) -> None:
    """Near and beyond half a turn the rotation part has length at most pi and still leads to the command."""
    reference = motion(20, rng)
    axes = rng.normal(size=(20, 3))
    rotvec = (np.pi - short_of_pi) * axes / np.linalg.norm(axes, axis=1, keepdims=True)
    command = apply_residual(reference, np.hstack([np.zeros((20, 3)), rotvec]))
    residual = pose_residual(reference, command)
    assert np.linalg.norm(residual[:, 3:], axis=1).max() <= np.pi + 1e-12
    same_poses(apply_residual(reference, residual), command, 1e-9)


def test_residual_is_read_back(rng: np.random.Generator) -> None:
    """Residuals of turns below half a turn are recovered from the poses they lead to."""
    reference, residual = motion(50, rng), rng.uniform(-1, 1, size=(50, 6))
    np.testing.assert_allclose(pose_residual(reference, apply_residual(reference, residual)), residual, atol=1e-13)


def test_residual_turns_with_the_common_frame(rng: np.random.Generator) -> None:
    """Seen from another frame both parts of the residual turn as vectors: they are in the common frame."""
    reference, command = motion(10, rng), motion(10, rng)
    T = se3.exp(rng.normal(size=6))
    turned = [moved(s, T) for s in (reference, command)]
    expected = pose_residual(reference, command).reshape(-1, 2, 3) @ T[:3, :3].T
    np.testing.assert_allclose(pose_residual(*turned).reshape(-1, 2, 3), expected, atol=1e-12)


def test_sign_of_quaternions_does_not_matter(rng: np.random.Generator) -> None:
    """Quaternions q and -q have the same residual."""
    reference, command = motion(10, rng), motion(10, rng)
    flipped = PoseSignal(command.position, -command.quaternion)
    np.testing.assert_allclose(pose_residual(reference, flipped), pose_residual(reference, command), atol=1e-15)


def test_position_only_signals_have_no_rotation_residual(rng: np.random.Generator) -> None:
    """Without orientations the rotation part is NaN, and applying it leaves the orientation as it is."""
    reference, command = motion(5, rng), motion(5, rng)
    residual = pose_residual(reference, PoseSignal(command.position))
    assert np.isnan(residual[:, 3:]).all()
    reached = apply_residual(reference, residual)
    np.testing.assert_allclose(reached.position, command.position, atol=1e-15)
    np.testing.assert_array_equal(reached.quaternion, reference.quaternion)
    assert apply_residual(PoseSignal(reference.position), residual).quaternion is None


def test_missing_samples_have_missing_residuals(rng: np.random.Generator) -> None:
    """A row of NaN on either side makes a row of NaN, and no other."""
    reference, command = motion(4, rng), motion(4, rng)
    position, quaternion = np.array(reference.position), np.array(reference.quaternion)
    position[2], quaternion[2] = np.nan, np.nan
    residual = pose_residual(PoseSignal(position, quaternion), command)
    assert np.isnan(residual).all(axis=1).tolist() == [False, False, True, False]


def test_lengths_must_agree(rng: np.random.Generator) -> None:
    """Signals and residuals of different lengths are refused."""
    with pytest.raises(DataError, match="5 and 4"):
        pose_residual(motion(5, rng), motion(4, rng))
    with pytest.raises(DataError, match=r"\(5, 6\)"):
        apply_residual(motion(5, rng), np.zeros((5, 3)))
