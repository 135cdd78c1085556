import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpcorrect import se3
from gpcorrect.arms import arm_named
from gpcorrect.errors import DataError
from gpcorrect.sim.plan import minimum_jerk, trapezoid
from gpcorrect.sim.reaching import Pace, Workspace, joint_tour, tour, upright, working_posture

ARMS = ["raven2_left", "raven2_right", "dvrk_psm"]
positive = st.floats(0.01, 10)


@given(positive, st.floats(10, 1000))
def test_minimum_jerk_starts_and_ends_at_rest(duration, rate):
    """Progress goes from 0 to 1 without turning back, and mirrors itself about its middle."""
    s = minimum_jerk(duration, rate)
    assert s[0] == 0.0
    assert s[-1] == pytest.approx(1.0)
    assert (np.diff(s) >= 0).all()
    np.testing.assert_allclose(s + s[::-1], 1.0, atol=1e-12)


@given(positive, positive, positive)
def test_trapezoid_keeps_speed_and_acceleration(distance, speed, acceleration):
    """Progress goes from 0 to 1 and exceeds neither limit."""
    s = distance * trapezoid(distance, speed, acceleration, 200.0)
    assert s[0] == 0.0
    assert s[-1] == pytest.approx(distance)
    v = np.diff(s) * 200.0
    assert (v > -1e-9).all()
    assert v.max() <= speed * (1 + 1e-9)
    assert np.abs(np.diff(v)).max(initial=0.0) * 200.0 <= acceleration * (1 + 1e-6) + 1e-6


def test_bad_paces_are_refused():
    with pytest.raises(DataError, match="finite rates above 0"):
        Pace(speed=0.0)


@pytest.mark.parametrize("name", ARMS)
def test_joint_tour_reaches_every_pose(name):
    """The joint path is continuous, keeps the limits, and its forward map is the tour."""
    arm, rng = arm_named(name), np.random.default_rng(0)
    T = arm.forward(working_posture(arm))
    box = Workspace(se3.pose(upright(arm.gravity), T[:3, 3]), np.array([0.08, 0.08, 0.02]), T[:3, :3], 0.4)
    path = tour(box.sample(arm, 6, rng), range(5), [Pace(pause=0.1)] * 5, 100.0)
    q = joint_tour(arm, path)
    np.testing.assert_allclose(arm.forward(q), path.T_base_tip, atol=1e-9)
    assert arm.chain.within_limits(q, 1e-9).all()
    assert np.abs(np.diff(q, axis=0)).max() < 0.05


def test_tours_go_straight_at_the_asked_speed():
    """Between two stops the tip stays on their line and never exceeds the speed; labels count the reaches."""
    rng = np.random.default_rng(1)
    stops = se3.pose(se3.matrix_from_rotvec(0.1 * rng.standard_normal((3, 3))), 0.1 * rng.standard_normal((3, 3)))
    path = tour(stops, [7, 8], [Pace(speed=0.05, pause=0.2)] * 2, 100.0)
    p = path.T_base_tip[:, :3, 3]
    assert np.linalg.norm(np.diff(p, axis=0), axis=1).max() * 100 <= 0.05 * (1 + 1e-9)
    assert set(np.unique(path.trajectory)) == {7, 8}
    first = p[path.trajectory == 7]
    line = (stops[1] - stops[0])[:3, 3]
    np.testing.assert_allclose(np.cross(first - stops[0, :3, 3], line), 0.0, atol=1e-12)
    np.testing.assert_allclose(path.T_base_tip[-1], stops[-1], atol=1e-12)


def test_workspaces_hold_their_targets():
    """Targets lie in the box, within the tilt, and within the arm's reach."""
    arm, rng = arm_named("raven2_left"), np.random.default_rng(2)
    T = arm.forward(working_posture(arm))
    axes, size = se3.pose(upright(arm.gravity), T[:3, 3]), np.array([0.08, 0.06, 0.02])
    targets = Workspace(axes, size, T[:3, :3], 0.4).sample(arm, 200, rng)
    local = (targets[:, :3, 3] - T[:3, 3]) @ axes[:3, :3]
    assert (np.abs(local) <= size / 2).all()
    assert np.ptp(local, axis=0) == pytest.approx(size, rel=0.1)
    assert se3.angle(targets[:, :3, :3] @ T[:3, :3].T).max() <= 0.4 + 1e-9


def test_unreachable_workspaces_are_refused():
    arm = arm_named("dvrk_psm")
    far = se3.pose(np.eye(3), np.array([0.0, 0.0, -3.0]))
    with pytest.raises(DataError, match="reaches hardly any"):
        Workspace(far, np.full(3, 0.01), np.eye(3), 0.1).sample(arm, 5, np.random.default_rng(0))


@pytest.mark.parametrize("gravity", [[-9.8, 0, 0], [0, 0, -9.8], [1.0, 2.0, -3.0]])
def test_upright_axes_point_up(gravity):
    """The axes are right-handed and the third one points against gravity."""
    axes = upright(np.array(gravity))
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    np.testing.assert_allclose(axes[:, 2], -np.array(gravity) / np.linalg.norm(gravity))
