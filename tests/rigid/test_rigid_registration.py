from __future__ import annotations

import numpy as np
import pytest
from rigid_planted import differences, motion, moved, noisy, planted, random_model, rotations, signal
from scipy.spatial.transform import Rotation

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.rigid import RigidModel, fit_pose, fit_position
from gpcorrect.types import PoseSignal


def frobenius(T: np.ndarray, observed: PoseSignal, command: PoseSignal) -> float:
    """Objective of Mahler 2014, Sec. IV-B, written out."""
    X, U = (se3.from_parts(s.position, s.quaternion) for s in (observed, command))
    return float(((T @ X - U) ** 2).sum())


@pytest.mark.parametrize("axes", [0, 1, 3])
def test_exact_pairs_give_the_planted_pose(axes: int, rng: np.random.Generator) -> None:
    """Noise-free pairs give the planted motion, however little the tool turns."""
    world = planted("pose", 40, rng, axes=axes)
    assert max(differences(fit_pose(world.observed, world.command), world.truth).values()) < 1e-9


def test_pose_is_the_minimum_of_the_papers_objective(rng: np.random.Generator) -> None:
    """No small step in any of six directions lowers the Frobenius sum of the paper."""
    world = planted("pose", 60, rng)
    command = noisy(world.command, rng, 0.01, 0.2)
    model = fit_pose(world.observed, command)
    T = se3.pose(model.R_position, model.t)
    least = frobenius(T, world.observed, command)
    steps = [sign * 1e-4 * axis for axis in np.eye(6) for sign in (1, -1)]
    assert min(frobenius(se3.exp(step) @ T, world.observed, command) for step in steps) > least


@pytest.mark.parametrize("rotation_weight", [0.0, 1e-3, 1.0])
def test_agrees_with_wahbas_problem(rotation_weight: float, rng: np.random.Generator) -> None:
    """SciPy's solver of Wahba's problem on centred points and weighted axes finds the same rotation."""
    world = planted("pose", 30, rng)
    command = noisy(world.command, rng, 0.01, 0.3)
    columns = [rotations(s).as_matrix().transpose(0, 2, 1).reshape(-1, 3) for s in (world.observed, command)]
    points = [s.position - s.position.mean(axis=0) for s in (world.observed, command)]
    vectors = [np.vstack([p, c]) for p, c in zip(points, columns, strict=True)]
    weights = np.concatenate([np.ones(30), np.full(90, rotation_weight)])
    R = Rotation.align_vectors(vectors[1], vectors[0], weights)[0].as_matrix()
    model = fit_pose(world.observed, command, rotation_weight=rotation_weight)
    np.testing.assert_allclose(model.R_position, R, atol=1e-7)


def test_registration_composes_with_changes_of_frame(rng: np.random.Generator) -> None:
    """Registering `A X` to `B U` gives `B T A^-1`, noise or not."""
    world = planted("pose", 50, rng)
    command = noisy(world.command, rng, 0.005, 0.1)
    A, B = se3.exp(rng.normal(size=(2, 6)))
    plain = fit_pose(world.observed, command)
    changed = fit_pose(moved(world.observed, A), moved(command, B))
    expected = B @ se3.pose(plain.R_position, plain.t) @ se3.invert(A)
    np.testing.assert_allclose(se3.pose(changed.R_position, changed.t), expected, atol=1e-10)


def test_error_falls_with_the_root_of_the_samples(rng: np.random.Generator) -> None:
    """A hundred times the samples bring the mean error of the rotation down about tenfold."""
    errors = {}
    for n in (20, 2000):
        angles = []
        for _ in range(20):
            world = planted("pose", n, rng)
            model = fit_pose(noisy(world.observed, rng, 0.001, 0.05), world.command)
            angles.append(differences(model, world.truth)["angle"])
        errors[n] = float(np.mean(angles))
    assert 7 < errors[20] / errors[2000] < 14


def test_positions_alone_give_the_planted_frame_and_the_kind_says_so(rng: np.random.Generator) -> None:
    """Where either side has no orientations the points are registered, also from one plane."""
    world = planted("pose", 40, rng)
    plane = world.observed.position * [1.0, 1.0, 0.0]
    flat = PoseSignal(plane)
    for observed, command in (
        (PoseSignal(world.observed.position), world.command),
        (world.observed, PoseSignal(world.command.position)),
        (flat, world.truth.apply(flat)),
    ):
        model = fit_pose(observed, command)
        assert model.kind == "position"
        assert max(differences(model, world.truth).values()) < 1e-9


def test_mirrored_points_still_give_a_rotation(rng: np.random.Generator) -> None:
    """Points that a reflection would explain best are registered by a proper rotation."""
    position = rng.normal(size=(30, 3))
    model = fit_position(PoseSignal(position), PoseSignal(position * [1, 1, -1]))
    assert np.linalg.det(model.R_position) == pytest.approx(1.0)


def test_sign_of_quaternions_does_not_matter_to_registration(rng: np.random.Generator) -> None:
    """Flipping the sign of some quaternions changes nothing."""
    world = planted("pose", 20, rng)
    command = noisy(world.command, rng, 0.01, 0.2)
    flipped = PoseSignal(command.position, command.quaternion * np.where(np.arange(20) % 2, 1, -1)[:, None])
    assert max(differences(fit_pose(world.observed, flipped), fit_pose(world.observed, command)).values()) < 1e-12


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_collinear_points_are_refused_with_their_spread(noise: float, rng: np.random.Generator) -> None:
    """A commanded straight line does not fix the turn about it, and tracker noise may not pretend it does."""
    line = np.linspace(0, 0.1, 50)[:, None] * [1.0, 2.0, -1.0]
    seen = random_model("pose", rng).apply(PoseSignal(line)).position + rng.normal(size=(50, 3)) * noise
    with pytest.raises(DegenerateError, match=r"on one line \(spread .* mm along"):
        fit_pose(PoseSignal(seen), PoseSignal(line))


def test_collinear_points_with_orientations_are_enough(rng: np.random.Generator) -> None:
    """Orientations fix the turn about a line that the points leave open."""
    line = np.linspace(0, 0.1, 20)[:, None] * [1.0, 2.0, -1.0]
    truth, observed = random_model("pose", rng), signal(line, Rotation.identity(20))
    assert max(differences(fit_pose(observed, truth.apply(observed)), truth).values()) < 1e-9


@pytest.mark.parametrize(
    ("observed", "message"),
    [
        (PoseSignal(np.ones((10, 3))), "coincide"),
        (PoseSignal(np.eye(3)[:2]), "at least 3 samples, got 2"),
        (PoseSignal(np.empty((0, 3))), "at least 3 samples, got 0"),
    ],
)
def test_too_little_motion_is_refused(observed: PoseSignal, message: str) -> None:
    """Coinciding or too few points are refused with the reason."""
    with pytest.raises(DegenerateError, match=message):
        fit_pose(observed, observed)


def test_contradictory_orientations_are_refused() -> None:
    """Orientations whose relations to each other cancel determine no rotation."""
    quarter = Rotation.from_rotvec(np.pi / 2 * np.array([[0, 0, k] for k in range(4)]))
    still = np.zeros((4, 3))
    with pytest.raises(DegenerateError, match="do not determine a rotation"):
        fit_pose(signal(still, Rotation.identity(4)), signal(still, quarter))


def test_missing_samples_are_refused_not_skipped(rng: np.random.Generator) -> None:
    """Dropping samples is the caller's decision; the message counts them."""
    position = rng.normal(size=(10, 3))
    position[3] = np.nan
    with pytest.raises(DataError, match="1 of 10 have missing numbers"):
        fit_pose(PoseSignal(position), PoseSignal(np.ones((10, 3))))


def test_mismatched_lengths_and_bad_rotation_weight_are_refused(rng: np.random.Generator) -> None:
    """Each observation needs its command, and rotations cannot count negatively."""
    poses = motion(10, rng)
    with pytest.raises(DataError, match="10 observed and 9 commanded"):
        fit_pose(poses, poses[:9])
    with pytest.raises(DataError, match="rotation_weight"):
        fit_pose(poses, poses, rotation_weight=-1.0)


def test_inputs_stay_as_they_were(rng: np.random.Generator) -> None:
    """Fitting changes no signal."""
    world = planted("pose", 10, rng)
    before = [np.array(a) for a in (world.observed.position, world.observed.quaternion)]
    assert isinstance(fit_pose(world.observed, world.command), RigidModel)
    after = (world.observed.position, world.observed.quaternion)
    for a, b in zip(before, after, strict=True):
        np.testing.assert_array_equal(a, b)
