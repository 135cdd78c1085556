"""From rays to points and poses: exact where the data are, weighted where they are not, with covariances that hold."""

from __future__ import annotations

import numpy as np
import pytest
from vision_support import cameras_of, path_of

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.types import FloatArray
from gpcorrect.vision import (
    END_EFFECTOR,
    Observations,
    PoseFilter,
    common_perpendicular,
    mean_midpoint,
    pose_closed_form,
    pose_from_observations,
    triangulate,
)
from gpcorrect.vision.settings import MotionSettings
from gpcorrect_studies.rendering import Stage

SEED = 403
CAMERAS = cameras_of(Stage.standard(SEED, pieces=0))
FOCAL = CAMERAS[0].intrinsics.focal


def _rays(point: FloatArray) -> FloatArray:
    local = np.array([camera.local(point)[0] for camera in CAMERAS])
    return local[:, :2] / local[:, 2:]


def test_two_skew_lines_have_their_common_perpendicular() -> None:
    """The x axis, and a line along y one unit above it: the midpoint is half way, the gap is one."""
    middle, gap = common_perpendicular(
        np.zeros(3), np.array([1.0, 0, 0]), np.array([3.0, 5, 1]), np.array([0, -2.0, 0])
    )
    assert np.allclose(middle, [3.0, 0.0, 0.5])
    assert gap == pytest.approx(1.0)
    with pytest.raises(DegenerateError, match="parallel"):
        common_perpendicular(np.zeros(3), np.array([1.0, 0, 0]), np.ones(3), np.array([-1.0, 0, 0]))


def test_exact_rays_meet_in_the_point() -> None:
    """The mean of midpoints and the least squares on the reprojection both give the point itself."""
    point = np.array([0.02, -0.03, 0.21])
    origins = np.array([camera.position for camera in CAMERAS])
    assert np.allclose(mean_midpoint(origins, point - origins), point, atol=1e-12)
    assert np.allclose(triangulate(CAMERAS, _rays(point)).position, point, atol=1e-12)
    with pytest.raises(DataError, match="two cameras"):
        triangulate(CAMERAS[:1], _rays(point)[:1])


def test_weighted_reprojection_beats_the_midpoint_and_knows_its_error() -> None:
    """With one camera ten times worse than the others, errors are smaller, and their covariance is the one reported."""
    rng, point = np.random.default_rng(SEED), np.array([0.0, 0.02, 0.2])
    noise = np.array([0.05, 0.05, 0.05, 0.5]) / FOCAL
    covariances = noise[:, None, None] ** 2 * np.eye(2)
    origins = np.array([camera.position for camera in CAMERAS])
    ours, paper, squares = [], [], []
    for _ in range(200):
        rays = _rays(point) + noise[:, None] * rng.standard_normal((4, 2))
        located = triangulate(CAMERAS, rays, covariances)
        error = located.position - point
        ours.append(error @ error)
        squares.append(error @ np.linalg.solve(located.covariance, error))
        local = np.column_stack([rays, np.ones(4)])
        directions = np.array([c.directions(d)[0] for c, d in zip(CAMERAS, local, strict=True)])
        paper.append(((mean_midpoint(origins, directions) - point) ** 2).sum())
    assert np.mean(ours) < 0.5 * np.mean(paper)
    assert 2.4 < np.mean(squares) < 3.7


def test_closed_form_and_observations_agree_on_exact_balls() -> None:
    """The closed form, and all observations at once, find the pose itself."""
    places = END_EFFECTOR.places
    for T in path_of(SEED, 3, 1.0):
        points = places @ T[:3, :3].T + T[:3, 3]
        closed = pose_closed_form(points, places).T_tracker_tool
        assert np.allclose(closed, T, atol=1e-12)
        rays = np.array([_rays(point) for point in points])
        ball, camera = (index.ravel() for index in np.indices((3, 4)))
        observations = Observations(camera, ball, rays.reshape(-1, 2), np.tile(np.eye(2) * 1e-8, (12, 1, 1)))
        start = se3.compose(T, se3.exp(np.array([0.01, -0.01, 0.005, 0.1, -0.1, 0.2])))
        assert np.allclose(pose_from_observations(CAMERAS, places, observations, start).T_tracker_tool, T, atol=1e-9)


def test_a_ball_that_one_camera_sees_still_counts() -> None:
    """Two balls seen by all and the third by one determine the pose, which triangulating balls one by one cannot."""
    places, T = END_EFFECTOR.places, path_of(SEED, 1)[0]
    rays = np.array([_rays(point) for point in places @ T[:3, :3].T + T[:3, 3]])
    ball, camera = np.array([0] * 4 + [1] * 4 + [2]), np.array([0, 1, 2, 3, 0, 1, 2, 3, 2])
    observations = Observations(camera, ball, rays[ball, camera], np.tile(np.eye(2) * 1e-8, (9, 1, 1)))
    start = se3.compose(T, se3.exp(np.array([0.0, 0.0, 0.0, 0.05, 0.05, 0.0])))
    assert np.allclose(pose_from_observations(CAMERAS, places, observations, start).T_tracker_tool, T, atol=1e-9)


def test_the_covariance_of_a_pose_is_that_of_its_errors() -> None:
    """Squared normalised errors of all six numbers average to six."""
    rng, places, T = np.random.default_rng(SEED), END_EFFECTOR.places, path_of(SEED, 1)[0]
    exact = np.array([_rays(point) for point in places @ T[:3, :3].T + T[:3, 3]]).reshape(-1, 2)
    ball, camera = (index.ravel() for index in np.indices((3, 4)))
    noise, squares = 0.1 / FOCAL, []
    for _ in range(150):
        rays = exact + noise * rng.standard_normal(exact.shape)
        observations = Observations(camera, ball, rays, np.tile(np.eye(2) * noise**2, (12, 1, 1)))
        fit = pose_from_observations(CAMERAS, places, observations, T)
        turn = se3.rotvec_from_matrix(fit.T_tracker_tool[:3, :3] @ T[:3, :3].T)
        error = np.concatenate([fit.T_tracker_tool[:3, 3] - T[:3, 3], turn])
        squares.append(error @ np.linalg.solve(fit.covariance, error))
    assert 5.0 < np.mean(squares) < 7.2


def test_balls_on_a_line_or_missing_are_refused() -> None:
    """Neither determines a pose."""
    places = END_EFFECTOR.places
    with pytest.raises(DegenerateError, match="line"):
        pose_closed_form(np.outer([0.0, 1.0, 2.0], [1.0, 0.0, 0.0]), places)
    with pytest.raises(DataError, match="missing"):
        pose_closed_form(np.full((3, 3), np.nan), places)
    row = np.array([[0.0, -0.038, 0.0], [0.0, 0.0, 0.0], [0.0, 0.038, 0.0], [0.038, 0.0, 0.0]])
    assert np.allclose(pose_closed_form(row, row).T_tracker_tool, np.eye(4))  # the fourth is beside the line of three


def _moving(t: float) -> FloatArray:
    T = np.eye(4)
    T[:3, 3] = [0.05 * t, 0.02 * t, 0.1]
    T[:3, :3] = se3.matrix_from_rotvec(np.array([0.0, 0.3 * t, 0.0]))
    return T


def test_the_filter_coasts_then_says_lost_and_is_never_nan() -> None:
    """Through a gap it follows the motion with growing doubt; after half a second it is lost, and finite throughout."""
    tracked, estimates = PoseFilter(MotionSettings(coast=0.5)), []
    assert tracked.step(-1.0).status == "lost"
    for i in range(60):
        t = i / 30.0
        estimates.append(tracked.step(t, _moving(t) if i < 30 or i >= 55 else None))
    assert [s.status for s in estimates[:30]] == ["measured"] * 30
    assert [s.status for s in estimates[30:44]] == ["coasting"] * 14
    assert {s.status for s in estimates[46:55]} == {"lost"}
    assert estimates[55].status == "measured"
    assert all(np.isfinite(s.T_tracker_tool).all() and np.isfinite(s.std).all() for s in estimates)
    assert np.linalg.norm(estimates[35].T_tracker_tool[:3, 3] - _moving(35 / 30)[:3, 3]) < 1e-3
    assert (np.diff([s.std[0] for s in estimates[30:44]]) > 0).all()


@pytest.mark.parametrize("hole", [0, 1, 2, 4, 8])
@pytest.mark.parametrize("jump", [0.01, 0.03, 0.06])
def test_the_way_of_a_jump_is_not_taken_for_a_speed(hole: int, jump: float) -> None:
    """After a jump in a hole, frames whose clocks are not known (they err by the speed) are not put beside the tool."""
    tracked, still, moved = PoseFilter(), np.eye(4), se3.pose(np.eye(3), np.array([jump, 0.0, 0.0]))
    times = np.arange(1, 30 + hole) / 30.0
    for t in times[:20]:
        tracked.step(t, still, np.diag([5e-5**2] * 3 + [3e-3**2] * 3))
    for t in times[20 : 20 + hole]:
        tracked.step(t)
    for t in times[20 + hole :]:
        motion = tracked.motion(t)
        off = 5e-5 + (0.0 if motion is None else 0.0075 * float(np.linalg.norm(motion.twist[:3])))
        seen = tracked.step(t, moved, np.diag([off**2] * 3 + [3e-3**2] * 3))
        error = np.linalg.norm(seen.T_tracker_tool[:3, 3] - moved[:3, 3])
        assert seen.status == "coasting" or error < 4.0 * seen.std[0]


def test_the_filter_disbelieves_one_jump_and_takes_a_repeated_one() -> None:
    """A single pose three decimetres off is bridged; when it stays there, or was found anew, it is taken."""
    tracked = PoseFilter()
    for i in range(20):
        tracked.step(i / 30.0, _moving(i / 30.0))
    off = _moving(0.66)
    off[0, 3] += 0.3
    assert tracked.step(20 / 30.0, off).status == "coasting"
    assert tracked.step(21 / 30.0, off).status == "coasting"
    assert tracked.step(22 / 30.0, off).status == "measured"
    assert tracked.step(23 / 30.0, _moving(0.7), sure=True).status == "measured"
    for i in range(24, 30):  # its speed is known again
        assert tracked.step(i / 30.0, _moving(i / 30.0)).status == "measured"
    for i, pose in enumerate([off, None, off, None, off]):  # never three frames in a row
        assert tracked.step((30 + i) / 30.0, pose).status == "coasting"
    with pytest.raises(DataError, match="order of time"):
        tracked.step(0.1)
