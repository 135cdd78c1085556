from __future__ import annotations

import numpy as np
import pytest
from rigid_planted import differences, noisy, planted, with_outliers
from scipy.spatial.transform import Rotation

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.rigid import RigidModel, fit_position, fit_separate, pose_residual
from gpcorrect.rigid.handeye import two_sided_rotations
from gpcorrect.types import PoseSignal


@pytest.mark.parametrize("axes", [2, 3])
def test_exact_pairs_give_both_registrations(axes: int, rng: np.random.Generator) -> None:
    """Positions and orientations of different points are recovered, each for itself."""
    world = planted("separate", 60, rng, axes=axes)
    assert max(differences(fit_separate(world.observed, world.command), world.truth).values()) < 1e-9


def test_positions_and_orientations_do_not_touch(rng: np.random.Generator) -> None:
    """Shuffled orientations leave the registration of the points as it is, and the other way round."""
    world = planted("separate", 60, rng)
    command = noisy(world.command, rng, 0.005, 0.1)
    order = rng.permutation(60)
    plain = fit_separate(world.observed, command)
    mixed_turns = fit_separate(world.observed, PoseSignal(command.position, command.quaternion[order]))
    mixed_points = fit_separate(world.observed, PoseSignal(command.position[order], command.quaternion))
    np.testing.assert_array_equal(mixed_turns.R_position, plain.R_position)
    np.testing.assert_array_equal(mixed_points.R_left, plain.R_left)


def test_outliers_count_for_almost_nothing_in_either(rng: np.random.Generator) -> None:
    """A tenth of gross errors moves either registration less than four times what noise alone does."""
    world = planted("separate", 400, rng)
    observed = noisy(world.observed, rng, 0.001, 0.02)
    dirty = with_outliers(observed, rng.permutation(400)[:40], rng)
    noise, both = (differences(fit_separate(o, world.command), world.truth) for o in (observed, dirty))
    assert all(both[part] < 4 * noise[part] for part in ("angle", "t"))


def test_one_axis_takes_the_smallest_turn_that_explains_all(rng: np.random.Generator) -> None:
    """Rotation about one axis is explained exactly, with a marker turn no larger than the planted one."""
    world = planted("separate", 60, rng, axes=1)
    model = fit_separate(world.observed, world.command)
    assert np.abs(pose_residual(model.apply(world.observed), world.command)).max() < 1e-9
    assert se3.angle(model.R_right) < se3.angle(world.truth.R_right)
    turns = se3.matrix_from_rotvec(np.linspace(-np.pi, np.pi, 400)[:, None] * [1.0, 0.0, 0.0])
    assert se3.angle(model.R_right) <= se3.angle(turns @ model.R_right).min() + 1e-9


def test_without_rotation_the_right_turn_is_the_identity(rng: np.random.Generator) -> None:
    """Where only the product of both turns is known it goes to the left one, and the data are explained."""
    world = planted("separate", 60, rng, swing_rad=0.0)
    model = fit_separate(world.observed, world.command)
    np.testing.assert_array_equal(model.R_right, np.eye(3))
    assert np.abs(pose_residual(model.apply(world.observed), world.command)).max() < 1e-9


def test_two_sided_rotations_are_a_least_squares_minimum(rng: np.random.Generator) -> None:
    """No random pair near the answer and none of a thousand far from it has a smaller sum of squares."""
    left, right = Rotation.random(2, random_state=rng).as_matrix()
    R_obs = Rotation.random(50, random_state=rng).as_matrix()
    turn = Rotation.from_rotvec(rng.normal(size=(50, 3)) * 0.2).as_matrix()
    R_cmd = turn @ left @ R_obs @ right
    best = two_sided_rotations(R_obs, R_cmd, np.ones(50))

    def cost(a: np.ndarray, b: np.ndarray) -> float:
        return float(((a @ R_obs @ b - R_cmd) ** 2).sum())

    near = se3.matrix_from_rotvec(rng.normal(size=(200, 2, 3)) * 1e-3)
    far = Rotation.random(2000, random_state=rng).as_matrix().reshape(1000, 2, 3, 3)
    tried = [cost(a @ best[0], b @ best[1]) for a, b in near] + [cost(a, b) for a, b in far]
    assert cost(*best) <= min(tried)


def test_separate_needs_orientations_and_points_off_a_line(rng: np.random.Generator) -> None:
    """What cannot be registered for itself is refused with the reason."""
    world = planted("separate", 20, rng)
    with pytest.raises(DataError, match="positions only"):
        fit_separate(PoseSignal(world.observed.position), world.command)
    line = PoseSignal(np.arange(20.0)[:, None] * np.ones(3), world.observed.quaternion)
    with pytest.raises(DegenerateError, match="on one line"):
        fit_separate(line, world.command)


def test_positions_are_those_of_the_robust_point_registration(rng: np.random.Generator) -> None:
    """Without outliers in reach of the loss, separate positions agree with the closed form to the noise."""
    world = planted("separate", 200, rng)
    command = noisy(world.command, rng, 1e-5, 1e-3)
    closed = fit_position(world.observed, command)
    model = fit_separate(world.observed, command)
    assert isinstance(model, RigidModel)
    gap = np.linalg.norm(model.apply(world.observed).position - closed.apply(world.observed).position, axis=1)
    assert gap.max() < 1e-5
