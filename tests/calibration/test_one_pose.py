"""One query in machine code agrees with stacks of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support import small_log

from gpcorrect import se3
from gpcorrect.calibration import CommandCorrector, FitSettings, fit_corrector, one_pose
from gpcorrect.calibration.poses import reference_twists
from gpcorrect.gpr import FeatureMap
from gpcorrect.rigid import RigidModel
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal


def rotation_vectors() -> FloatArray:
    """Random ones, tiny ones, and ones of nearly pi about every kind of axis."""
    rng = np.random.default_rng(5)
    axes = rng.standard_normal((400, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    axes = np.concatenate([axes, np.eye(3), -np.eye(3)])
    angles = np.concatenate(
        [rng.uniform(0, np.pi, 200), 10 ** rng.uniform(-12, -4, 100), np.pi - 10 ** rng.uniform(-6, -2, 106)]
    )
    return axes * angles[:, None]


@pytest.mark.parametrize(
    "name", ["matrix_from_quaternion", "quaternion_from_matrix", "matrix_from_rotvec", "rotvec_from_matrix"]
)
def test_one_at_a_time_is_the_stack(name: str) -> None:
    """Each function equals its namesake in `se3` for every kind of rotation."""
    vectors = rotation_vectors()
    matrices = se3.matrix_from_rotvec(vectors)
    given = {"rotvec": vectors, "matrix": matrices, "quaternion": se3.quaternion_from_matrix(matrices)}[
        name.split("_")[-1]
    ]
    expected = getattr(se3, name)(given)
    for one, wanted in zip(given, expected, strict=True):
        np.testing.assert_allclose(
            getattr(one_pose, f"_{name}")(one), wanted, atol=2e-9 if "rotvec_from" in name else 1e-12
        )


def marker(rng: np.random.Generator) -> RigidModel:
    """Return a registration with everything in it: frames, lever arm, and another orientation of the tool."""
    turn, left, right = se3.matrix_from_rotvec(rng.normal(size=(3, 3)))
    return RigidModel("marker", turn, rng.normal(size=3), 0.05 * rng.normal(size=3), left, right)


@pytest.mark.parametrize("kinds", [("pose",), ("pose", "velocity"), ("euler", "velocity")])
@pytest.mark.parametrize("wide", [False, True])
def test_inputs_of_one_query_are_their_row_in_the_stack(kinds: tuple[str, ...], wide: bool) -> None:
    """Reference pose and features agree with those of stacks for every kind of feature and registration."""
    rng = np.random.default_rng(11)
    rigid, rotvecs = marker(rng), rng.normal(size=(60, 3)) * (2.0 if wide else 0.3)
    quaternions = se3.quaternion_from_matrix(se3.matrix_from_rotvec(rotvecs))
    observed = PoseSignal(0.05 * rng.normal(size=(60, 3)), quaternions)
    twist = rng.normal(size=(60, 6))
    reference, R = rigid.apply(observed), se3.matrix_from_quaternion(quaternions)
    assert reference.quaternion is not None
    stacks = reference.position, se3.matrix_from_quaternion(reference.quaternion), reference_twists(rigid, R, twist)
    features = FeatureMap(kinds).fit(*stacks)
    assert features.rotation == ("euler" if "euler" in kinds else "columns" if wide else "rotvec")
    X, frame = features.transform(*stacks), one_pose.frame(rigid, features)
    region = np.array([X.min(axis=0), np.append(X[:, :-1].max(axis=0), np.sort(X[:, -1])[-3])])
    for row, pose in enumerate(np.hstack([observed.position, quaternions])):
        good, position, rotation, x, near = one_pose.inputs(pose, np.array(twist[row]), np.zeros(0), frame, region)
        assert good
        assert near == (X[row, -1] <= region[1, -1]) or np.isclose(X[row], region, atol=1e-9).any()
        np.testing.assert_allclose(position, stacks[0][row], rtol=0, atol=1e-12)
        np.testing.assert_allclose(rotation, stacks[1][row], rtol=0, atol=1e-12)
        np.testing.assert_allclose(x, X[row], rtol=0, atol=1e-10)


def log_without_orientation() -> CalibrationLog:
    log = small_log()
    return replace(
        log, tracker_cp=PoseSignal(log.tracker_cp.position), setpoint_cp=PoseSignal(log.setpoint_cp.position)
    )


@pytest.fixture(scope="module", params=["pose,velocity", "position only"])
def any_corrector(request: pytest.FixtureRequest) -> CommandCorrector:
    """Return correctors of poses and of positions only."""
    if request.param == "position only":
        return fit_corrector(log_without_orientation(), FitSettings(inducing=300, search_samples=150, marker="none"))
    corrector: CommandCorrector = request.getfixturevalue("small_corrector")
    return corrector


def test_one_query_is_its_row_of_the_batch(any_corrector: CommandCorrector) -> None:
    """Command, deviation, interval, domain and status equal the batch's to 1e-10, amid the data and far outside."""
    log, rng = small_log(seed=4), np.random.default_rng(0)
    rows = rng.choice(len(log), 200, replace=False)
    desired = PoseSignal(
        log.tracker_cp.position[rows] * rng.uniform(0.5, 4.0, (200, 1)), log.tracker_cp.quaternion[rows]
    )
    twist = 0.1 * rng.normal(size=(200, 6))
    batch = any_corrector.correct_observed(desired, twist)
    assert 0 < batch.in_domain.sum() < 200
    for row in range(200):
        one = any_corrector.correct(np.concatenate([desired.position[row], desired.quaternion[row]]), twist[row])
        np.testing.assert_allclose(one.position, batch.position[row], rtol=0, atol=1e-10)
        np.testing.assert_allclose(one.quaternion, batch.quaternion[row], rtol=0, atol=1e-10)
        np.testing.assert_allclose(one.std, batch.std[row], rtol=0, atol=1e-10)
        np.testing.assert_allclose(one.interval95, batch.interval95[row], rtol=0, atol=1e-10)
        assert (one.in_domain, one.status) == (batch.in_domain[row], batch.status[row])


def test_the_form_of_a_query_does_not_matter(small_corrector: CommandCorrector) -> None:
    """Lists, strided, read-only, float32 and integer arrays are answered alike, and none of them is compiled for."""
    pose, twist = np.array([0.125, 0.0, -0.125, 1.0, 0.0, 0.0, 0.0]), np.zeros(6)
    expected = small_corrector.correct(pose, twist)
    compiled = len(one_pose.inputs.signatures)
    frozen = pose.copy()
    frozen.setflags(write=False)
    for form in (pose.tolist(), np.repeat(pose, 2)[::2], frozen, pose.astype(np.float32)):
        np.testing.assert_array_equal(small_corrector.correct(form, [0] * 6).position, expected.position)
    assert len(one_pose.inputs.signatures) == compiled
