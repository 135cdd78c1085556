"""Laws of rigid motions: group axioms, exponential map, means, nearest rotation, interpolation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import expm

from gpcorrect import se3
from gpcorrect.errors import DataError

unit_range = st.floats(-1.0, 1.0, allow_subnormal=False)
directions = arrays(np.float64, 3, elements=unit_range).filter(lambda v: np.linalg.norm(v) > 0.1)
translations = arrays(np.float64, 3, elements=st.floats(-10.0, 10.0))
generic_angles = st.floats(0.0, 3.1)
tiny_angles = st.floats(-12.0, -3.0).map(lambda exponent: 10.0**exponent)
near_pi_angles = st.floats(0.0, 1e-9).map(lambda gap: np.pi - gap)


def rotvecs(angles):
    return st.builds(lambda v, a: a * v / np.linalg.norm(v), directions, angles)


def tangents(angles):
    return st.builds(lambda rho, phi: np.concatenate([rho, phi]), translations, rotvecs(angles))


poses = tangents(generic_angles).map(se3.exp)


def random_rotations(n, seed=0):
    return se3.matrix_from_rotvec(np.random.default_rng(seed).normal(size=(n, 3)))


@given(poses, poses, poses)
def test_composition_is_associative(A, B, C):
    """(A B) C = A (B C)."""
    left, right = se3.compose(se3.compose(A, B), C), se3.compose(A, se3.compose(B, C))
    np.testing.assert_allclose(left, right, atol=1e-13)


@given(poses)
def test_inverse_and_identity(T):
    """T T^-1 = T^-1 T = I, and I T = T I = T."""
    np.testing.assert_allclose(se3.compose(T, se3.invert(T)), np.eye(4), atol=1e-13)
    np.testing.assert_allclose(se3.compose(se3.invert(T), T), np.eye(4), atol=1e-13)
    np.testing.assert_array_equal(se3.compose(np.eye(4), T, np.eye(4)), T)


@given(poses, poses)
def test_inverse_of_a_product(A, B):
    """(A B)^-1 = B^-1 A^-1."""
    np.testing.assert_allclose(se3.invert(se3.compose(A, B)), se3.compose(se3.invert(B), se3.invert(A)), atol=1e-13)


@given(tangents(st.one_of(tiny_angles, st.just(0.0))))
def test_log_undoes_exp_near_identity(xi):
    """log(exp(xi)) = xi to relative rounding for angles from 0 and 1e-12 to 1e-3."""
    back = se3.log(se3.exp(xi))
    np.testing.assert_allclose(back[3:], xi[3:], atol=1e-15, rtol=1e-12)
    np.testing.assert_allclose(back[:3], xi[:3], atol=1e-13)


@given(tangents(generic_angles))
def test_log_undoes_exp(xi):
    """log(exp(xi)) = xi for angles up to 3.1 rad."""
    np.testing.assert_allclose(se3.log(se3.exp(xi)), xi, atol=1e-12)


@given(tangents(near_pi_angles))
def test_exp_undoes_log_near_half_a_turn(xi):
    """exp(log(T)) = T for angles from pi - 1e-9 to pi, where the axis may flip sign."""
    T = se3.exp(xi)
    np.testing.assert_allclose(se3.exp(se3.log(T)), T, atol=1e-12)
    assert np.linalg.norm(se3.log(T)[3:]) == pytest.approx(np.linalg.norm(xi[3:]), abs=1e-12)


@given(tangents(generic_angles), st.floats(0.0, 1.0))
def test_exp_of_parts_of_a_twist_multiply(xi, part):
    """exp(s xi) exp((1 - s) xi) = exp(xi): motions along one screw commute and add."""
    product = se3.compose(se3.exp(part * xi), se3.exp((1 - part) * xi))
    np.testing.assert_allclose(product, se3.exp(xi), atol=1e-12)


@given(tangents(st.one_of(generic_angles, tiny_angles, near_pi_angles)))
def test_exp_agrees_with_the_matrix_exponential(xi):
    """The map equals the power series of the 4 x 4 twist matrix, by squaring, within its rounding."""
    x, y, z = xi[3:]
    twist = np.zeros((4, 4))
    twist[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    twist[:3, 3] = xi[:3]
    np.testing.assert_allclose(se3.exp(xi), expm(twist), atol=1e-12)


@given(rotvecs(st.floats(1e-3, 3.0)), directions)
def test_left_jacobian_inverse_is_the_rate_of_the_rotation_vector(phi, omega):
    """d/dt log(exp(t omega) R) at 0 is J^-1 omega, by central differences."""
    R, h = se3.matrix_from_rotvec(phi), 1e-6
    ahead, behind = (se3.rotvec_from_matrix(se3.matrix_from_rotvec(s * omega) @ R) for s in (h, -h))
    rate = (ahead - behind) / (2 * h)
    np.testing.assert_allclose(se3.left_jacobian_inverse(phi) @ omega, rate, atol=1e-5)


@given(arrays(np.float64, 4, elements=unit_range).filter(lambda q: np.linalg.norm(q) > 0.1), st.floats(0.1, 9.0))
def test_quaternion_sign_and_scale_do_not_matter(q, scale):
    """q, -q and s q are one rotation, and the returned quaternion has w >= 0 and length 1."""
    R = se3.matrix_from_quaternion(q)
    np.testing.assert_allclose(se3.matrix_from_quaternion(-q), R, atol=1e-15)
    np.testing.assert_allclose(se3.matrix_from_quaternion(scale * q), R, atol=1e-14)
    back = se3.quaternion_from_matrix(R)
    assert back[0] >= 0
    assert np.linalg.norm(back) == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_allclose(abs(back @ q) / np.linalg.norm(q), 1.0, atol=1e-14)


def test_quaternions_are_scalar_first():
    """(cos 45, 0, 0, sin 45) wxyz turns x into y."""
    R = se3.matrix_from_quaternion(np.array([1.0, 0.0, 0.0, 1.0]))
    np.testing.assert_allclose(R @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15)


@given(poses)
def test_parts_and_pose_round_trip(T):
    """A pose taken apart and put together is the same pose."""
    np.testing.assert_allclose(se3.from_parts(*se3.to_parts(T)), T, atol=1e-14)


@given(rotvecs(generic_angles), poses)
def test_angle_is_invariant_to_conjugation(phi, T):
    """The angle of Q R Q^T is that of R, and equals the length of the rotation vector."""
    Q, R = T[:3, :3], se3.matrix_from_rotvec(phi)
    assert se3.angle(R) == pytest.approx(np.linalg.norm(phi), abs=1e-12)
    assert se3.angle(Q @ R @ Q.T) == pytest.approx(np.linalg.norm(phi), abs=1e-7)


@given(poses, arrays(np.float64, (4, 3), elements=st.floats(-0.5, 0.5)))
def test_mean_of_symmetric_perturbations_is_the_centre(T, spread):
    """Equal and opposite turns about a rotation average to that rotation."""
    offsets = se3.matrix_from_rotvec(np.concatenate([spread, -spread]))
    np.testing.assert_allclose(se3.rotation_mean(offsets @ T[:3, :3]), T[:3, :3], atol=1e-10)


@given(poses, st.integers(0, 1000))
def test_rotation_mean_moves_with_the_rotations(T, seed):
    """mean(Q R_i) = Q mean(R_i) and mean(R_i Q) = mean(R_i) Q."""
    Q = T[:3, :3]
    small = np.random.default_rng(seed).normal(scale=0.3, size=(5, 3))
    rotations = se3.matrix_from_rotvec(small)
    centre = se3.rotation_mean(rotations)
    np.testing.assert_allclose(se3.rotation_mean(Q @ rotations), Q @ centre, atol=1e-10)
    np.testing.assert_allclose(se3.rotation_mean(rotations @ Q), centre @ Q, atol=1e-10)


def test_weights_count_as_repetition():
    """A weight of 3 equals three copies."""
    R = random_rotations(3, seed=4)
    thrice = se3.rotation_mean(R[[0, 0, 0, 1, 2]])
    np.testing.assert_allclose(se3.rotation_mean(R, weights=np.array([3.0, 1.0, 1.0])), thrice, atol=1e-12)


def test_mean_of_nothing_is_refused():
    """No rotations have no mean."""
    with pytest.raises(DataError, match="no rotations"):
        se3.rotation_mean(np.empty((0, 3, 3)))


@given(arrays(np.float64, (3, 3), elements=st.floats(-2.0, 2.0)), st.integers(0, 1000))
def test_nearest_rotation_is_a_rotation_and_none_is_nearer(matrix, seed):
    """The result is proper orthogonal and no other rotation has a smaller Frobenius distance."""
    R = se3.nearest_rotation(matrix)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0, abs=1e-12)
    rng = np.random.default_rng(seed)
    nearby = se3.matrix_from_rotvec(rng.normal(scale=0.05, size=(20, 3))) @ R
    others = np.concatenate([nearby, random_rotations(20, seed)])
    distances = np.linalg.norm(others - matrix, axis=(1, 2))
    assert np.linalg.norm(R - matrix) <= distances.min() + 1e-12


@given(poses)
def test_nearest_rotation_leaves_rotations_alone(T):
    """A rotation is nearest to itself, and scaling does not turn it."""
    np.testing.assert_allclose(se3.nearest_rotation(3.0 * T[:3, :3]), T[:3, :3], atol=1e-13)


def test_nearest_rotation_refuses_missing_numbers():
    """A matrix with NaN has no nearest rotation."""
    with pytest.raises(DataError, match="NaN"):
        se3.nearest_rotation(np.full((3, 3), np.nan))


@given(rotvecs(st.floats(0.0, 3.0)), poses, st.floats(0.0, 1.0))
def test_interpolation_turns_at_constant_speed(phi, T, part):
    """At a part s of the time the rotation is exp(s phi) R_0, the ends included."""
    start = T[:3, :3]
    rotations = np.stack([start, se3.matrix_from_rotvec(phi) @ start])
    times, at = np.array([2.0, 6.0]), np.array([2.0, 2.0 + 4.0 * part, 6.0])
    expected = se3.matrix_from_rotvec(np.array([0.0, part, 1.0])[:, None] * phi) @ start
    np.testing.assert_allclose(se3.interpolate_rotations(times, rotations, at), expected, atol=1e-12)


def test_interpolation_passes_through_every_sample():
    """At the sample times the samples themselves come back."""
    times, rotations = np.array([0.0, 0.1, 0.5, 2.0]), random_rotations(4)
    np.testing.assert_allclose(se3.interpolate_rotations(times, rotations, times), rotations, atol=1e-14)


@pytest.mark.parametrize("at", [[-0.1], [1.1], [np.nan]])
def test_interpolation_outside_the_samples_is_refused(at):
    """Times before, after or missing raise instead of extrapolating."""
    with pytest.raises(DataError, match="samples cover"):
        se3.interpolate_rotations(np.array([0.0, 1.0]), random_rotations(2), np.array(at))


@pytest.mark.parametrize("times", [[0.0], [0.0, 0.0], [1.0, 0.0]])
def test_interpolation_needs_increasing_times(times):
    """One sample, repeated or backward times raise instead of dividing by zero."""
    with pytest.raises(DataError, match="increasing"):
        se3.interpolate_rotations(np.array(times), random_rotations(len(times)), np.array([0.0]))


@pytest.mark.parametrize("lead", [(), (1,), (5,), (2, 3), (0,), (0, 2), (2, 0)])
def test_stacks_equal_loops(lead):
    """Every map of a stack is the stack of the maps."""
    rng = np.random.default_rng(8)
    xi = rng.normal(size=(*lead, 6))
    T = se3.exp(xi)
    loop = [se3.exp(x) for x in xi.reshape(-1, 6)]
    np.testing.assert_allclose(T.reshape(-1, 4, 4), np.array(loop).reshape(-1, 4, 4), atol=1e-15)
    for function in (se3.log, se3.invert, lambda P: se3.to_parts(P)[1], lambda P: se3.angle(P[..., :3, :3])):
        stacked = function(T)
        single = np.array([function(P) for P in T.reshape(-1, 4, 4)])
        np.testing.assert_allclose(stacked.reshape(single.shape), single, atol=1e-15)
        assert stacked.shape[: len(lead)] == lead


def test_missing_samples_stay_missing_and_alone():
    """A row of NaN gives a row of NaN and leaves its neighbours as they are."""
    R = random_rotations(3)
    broken = R.copy()
    broken[1] = np.nan
    for function in (se3.rotvec_from_matrix, se3.quaternion_from_matrix):
        result, whole = function(broken), function(R)
        assert np.isnan(result[1]).all()
        np.testing.assert_array_equal(result[[0, 2]], whole[[0, 2]])
    assert np.isnan(se3.matrix_from_quaternion(np.full((2, 4), np.nan))).all()


def test_a_zero_quaternion_is_refused():
    """Four zeros name no rotation."""
    with pytest.raises(DataError, match="zeros"):
        se3.matrix_from_quaternion(np.array([[1.0, 0, 0, 0], [0, 0, 0, 0]]))


def test_inputs_are_left_alone():
    """No function writes into its arguments."""
    T = se3.exp(np.random.default_rng(1).normal(size=(4, 6)))
    before = T.copy()
    se3.log(T), se3.invert(T), se3.compose(T, T), se3.nearest_rotation(T[:, :3, :3])
    np.testing.assert_array_equal(T, before)
