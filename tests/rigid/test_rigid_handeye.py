from __future__ import annotations

import numpy as np
import pytest
from rigid_planted import (
    Planted,
    differences,
    motion,
    moved,
    noisy,
    planted,
    random_model,
    signal,
    with_outliers,
)
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.rigid import RigidModel, fit_marker, fit_separate, pose_residual, rotation_observability
from gpcorrect.rigid.registration import fit_balanced
from gpcorrect.types import PoseSignal


@pytest.mark.parametrize("swing_rad", [0.1, 0.6, 3.0])
def test_exact_pairs_give_the_planted_marker(swing_rad: float, rng: np.random.Generator) -> None:
    """Noise-free pairs give frames, lever arm and marker orientation, from small turns and from any."""
    world = planted("marker", 60, rng, swing_rad)
    assert max(differences(fit_marker(world.observed, world.command), world.truth).values()) < 1e-9


def test_two_axes_of_rotation_are_enough(rng: np.random.Generator) -> None:
    """A tool that turns about two axes only determines all twelve unknowns."""
    world = planted("marker", 60, rng, axes=2)
    assert max(differences(fit_marker(world.observed, world.command), world.truth).values()) < 1e-9


def test_marker_at_the_tip_has_no_offset(rng: np.random.Generator) -> None:
    """Data of a plain registration give a zero lever arm and no turn of the marker."""
    world = planted("pose", 60, rng)
    assert max(differences(fit_marker(world.observed, world.command), world.truth).values()) < 1e-9


def test_lever_arm_from_positions_alone(rng: np.random.Generator) -> None:
    """Without commanded orientations frames and lever arm follow from positions; the turn stays open."""
    world = planted("marker", 60, rng)
    model = fit_marker(world.observed, PoseSignal(world.command.position))
    unturned = RigidModel("marker", model.R_position, model.t, model.offset, model.R_left, world.truth.R_right)
    assert max(differences(unturned, world.truth).values()) < 1e-9
    np.testing.assert_array_equal(model.R_right, np.eye(3))


def test_noise_moves_the_answer_by_what_it_should(rng: np.random.Generator) -> None:
    """The lever arm errs by about noise / (swing root n): between a third and three times that on average."""
    n, noise_m, swing = 400, 0.001, 0.5
    errors, gains = [], []
    for _ in range(8):
        world = planted("marker", n, rng, swing)
        observed = noisy(world.observed, rng, noise_m, 0.002)
        errors.append(differences(fit_marker(observed, world.command), world.truth)["offset"])
        gains.append(rotation_observability(observed, world.command).gains.mean())
    expected = noise_m * np.sqrt(3) / (np.mean(gains) * np.sqrt(n))
    assert 1 / 3 < np.mean(errors) / expected < 3


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_outliers_count_for_almost_nothing(share: float, rng: np.random.Generator) -> None:
    """Gross errors in a share of the samples move the answer less than four times what noise alone does."""
    world = planted("marker", 400, rng)
    observed = noisy(world.observed, rng, 0.001, 0.02)
    rows = rng.permutation(400)[: int(share * 400)]
    dirty = with_outliers(observed, rows, rng)
    noise, both = (differences(fit_marker(o, world.command), world.truth) for o in (observed, dirty))
    assert all(both[part] < 4 * noise[part] for part in noise)


def test_one_long_block_of_outliers_is_survived(rng: np.random.Generator) -> None:
    """A lost fiducial that freezes a tenth of the recording at one wrong pose does not steer the answer."""
    world = planted("marker", 400, rng)
    position, quaternion = np.array(world.observed.position), np.array(world.observed.quaternion)
    position[100:140], quaternion[100:140] = position[0] + 0.3, Rotation.random(random_state=1).as_quat()
    model = fit_marker(PoseSignal(position, quaternion), world.command)
    assert max(differences(model, world.truth).values()) < 1e-6


@pytest.mark.parametrize("part", ["base", "tracker", "marker"])
def test_marker_registration_composes_with_changes_of_frame(part: str, rng: np.random.Generator) -> None:
    """Moving the frame of base, tracker or marker leaves the predicted poses as they are."""
    world = planted("marker", 200, rng)
    observed, T = noisy(world.observed, rng, 0.002, 0.05), se3.exp(rng.normal(size=6))
    plain = fit_marker(observed, world.command).apply(observed)
    if part == "base":
        changed = fit_marker(observed, moved(world.command, T)).apply(observed)
        plain = moved(plain, T)
    else:
        X = se3.from_parts(observed.position, observed.quaternion)
        observed = PoseSignal(*se3.to_parts(T @ X if part == "tracker" else X @ T))
        changed = fit_marker(observed, world.command).apply(observed)
    assert np.abs(pose_residual(plain, changed)).max() < 1e-6


def test_agrees_with_a_general_optimiser(rng: np.random.Generator) -> None:
    """From the answer, SciPy's least squares on the same loss finds nothing lower."""
    world = planted("marker", 150, rng)
    observed = noisy(world.observed, rng, 0.002, 0.05)
    model = fit_marker(observed, world.command)
    R_obs, R_cmd = (se3.matrix_from_quaternion(s.quaternion) for s in (observed, world.command))

    def norms(x: np.ndarray) -> np.ndarray:
        R = se3.matrix_from_rotvec(x[:3]) @ model.R_position
        R_right = model.R_right @ se3.matrix_from_rotvec(x[6:9])
        arm = observed.position + R_obs @ (model.offset + x[9:])
        position = arm @ R.T + model.t + x[3:6] - world.command.position
        chord = (R @ R_obs @ R_right - R_cmd).reshape(-1, 9) / np.sqrt(2)
        return np.array([np.linalg.norm(position, axis=1), np.linalg.norm(chord, axis=1)])

    scale = np.median(norms(np.zeros(12)), axis=1)[:, None] / np.sqrt(2.365973884)

    def root_loss(x: np.ndarray) -> np.ndarray:
        return np.sqrt(9 * np.log1p((norms(x) / (3 * scale)) ** 2)).ravel()

    best = least_squares(root_loss, np.zeros(12), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    assert (root_loss(np.zeros(12)) ** 2).sum() / 2 <= best.cost * (1 + 1e-6)


def test_long_recordings_are_thinned_not_cut(rng: np.random.Generator) -> None:
    """Twenty thousand samples whose turns come late in the recording still determine the marker."""
    still, turning = motion(15000, rng, swing_rad=0.0), motion(5000, rng)
    observed = PoseSignal(
        np.vstack([still.position, turning.position]), np.vstack([still.quaternion, turning.quaternion])
    )
    truth = random_model("marker", rng)
    assert max(differences(fit_marker(observed, truth.apply(observed)), truth).values()) < 1e-9


def test_same_data_same_answer(rng: np.random.Generator) -> None:
    """Two fits of the same data agree to the last bit, and the sign of quaternions does not matter."""
    world = planted("marker", 100, rng)
    observed = noisy(world.observed, rng, 0.002, 0.05)
    signs = np.where(np.arange(100) % 2, 1.0, -1.0)[:, None]
    flipped = PoseSignal(observed.position, observed.quaternion * signs)
    first, second, third = (fit_marker(o, world.command) for o in (observed, observed, flipped))
    assert first.to_dict() == second.to_dict()
    assert max(differences(first, third).values()) < 1e-9


def tilted(world: Planted, rng: np.random.Generator) -> Planted:
    """Turn the marker on the tool, so that its axis of rotation is no axis of coordinates."""
    turn = Rotation.random(random_state=rng)
    observed = signal(world.observed.position, Rotation.from_quat(world.observed.quaternion, scalar_first=True) * turn)
    return Planted(observed, world.truth.apply(observed), world.truth)


def test_rotation_about_one_axis_is_refused_and_the_axis_named(rng: np.random.Generator) -> None:
    """With one axis the lever arm along it is not observable: the message names the axis."""
    world = tilted(planted("marker", 60, rng, axes=1), rng)
    with pytest.raises(DegenerateError, match=r"one axis only, \(.*lever arm along it .* not observable .*%"):
        fit_marker(world.observed, world.command)
    observability = rotation_observability(world.observed, world.command)
    assert observability.n_axes == 1
    R_obs = se3.matrix_from_quaternion(world.observed.quaternion)
    np.testing.assert_allclose(
        R_obs @ observability.axes[0], (R_obs @ observability.axes[0])[:1].repeat(60, 0), atol=1e-7
    )


@pytest.mark.parametrize("swing_rad", [0.0, 0.01])
def test_no_rotation_is_refused(swing_rad: float, rng: np.random.Generator) -> None:
    """Turns of a degree or none do not separate the lever arm from the frames."""
    world = planted("marker", 60, rng, swing_rad)
    with pytest.raises(DegenerateError, match="hardly rotated"):
        fit_marker(world.observed, world.command)


@pytest.mark.parametrize("with_orientation", [True, False])
def test_outliers_do_not_pass_for_rotation(with_orientation: bool, rng: np.random.Generator) -> None:
    """A tool that never turned is refused even when the tracker's gross errors turn."""
    world = planted("marker", 100, rng, swing_rad=0.0)
    observed = with_outliers(world.observed, np.arange(0, 100, 11), rng)
    command = world.command if with_orientation else PoseSignal(world.command.position)
    with pytest.raises(DegenerateError, match="hardly rotated"):
        fit_marker(observed, command)


def test_gain_is_the_swing_of_a_lever_arm(rng: np.random.Generator) -> None:
    """A gain is the RMS movement of a metre along its axis; no direction swings less than the first."""
    observed = motion(80, rng)
    observability = rotation_observability(observed, observed)
    R = se3.matrix_from_quaternion(observed.quaternion)

    def swing(direction: np.ndarray) -> float:
        ends = R @ direction
        return float(np.sqrt(((ends - ends.mean(axis=0)) ** 2).sum(axis=1).mean()))

    np.testing.assert_allclose([swing(axis) for axis in observability.axes], observability.gains, rtol=1e-10)
    others = rng.normal(size=(20, 3))
    assert min(swing(d / np.linalg.norm(d)) for d in others) >= observability.gains[0]


def test_positions_alone_cannot_show_a_marker(rng: np.random.Generator) -> None:
    """Without observed orientations there is nothing to turn the lever arm with."""
    poses = motion(10, rng)
    assert rotation_observability(PoseSignal(poses.position), poses) is None
    with pytest.raises(DataError, match="observed orientations"):
        fit_marker(PoseSignal(poses.position), poses)


def test_two_samples_are_refused(rng: np.random.Generator) -> None:
    """Two poses are too few."""
    poses = motion(2, rng)
    with pytest.raises(DegenerateError, match="at least 3 samples, got 2"):
        fit_marker(poses, poses)


@pytest.mark.parametrize("kind", ["pose", "marker", "separate"])
def test_a_fit_that_starts_nearby_ends_at_the_same_model(kind: str, rng: np.random.Generator) -> None:
    """From the model of all samples the fit of most of them ends where it ends by itself, far within the noise."""
    fit = {"pose": fit_balanced, "marker": fit_marker, "separate": fit_separate}[kind]
    world = planted(kind, 400, rng)
    observed = with_outliers(noisy(world.observed, rng, 0.001, 0.02), rng.permutation(400)[:40], rng)
    near = fit(observed, world.command)
    alone, led = fit(observed[:320], world.command[:320]), fit(observed[:320], world.command[:320], near)
    assert max(differences(led, alone).values()) < 2e-5
    assert max(differences(near, alone).values()) > 1e-4
