"""Laws of the closed-form inverse of remote-centre arms."""

import numpy as np
import pytest

from gpcorrect import se3
from gpcorrect.arms import DA_VINCI_TOOL, Chain, Joint, RemoteCentreArm, dvrk_psm, raven2
from gpcorrect.errors import DataError

TOOL = se3.exp(np.array([0.004, -0.002, 0.015, 0.3, -0.8, 0.5]))
ARMS = {
    "raven2_left": lambda: raven2("left"),
    "raven2_right": lambda: raven2("right"),
    "raven2_left_da_vinci": lambda: raven2("left", DA_VINCI_TOOL),
    "raven2_right_with_tool": lambda: raven2("right", tool=TOOL),
    "dvrk_psm": dvrk_psm,
}


@pytest.fixture(params=ARMS)
def arm(request) -> RemoteCentreArm:
    return ARMS[request.param]()


def random_joints(arm, n, seed=0):
    return np.random.default_rng(seed).uniform(arm.limits[:, 0], arm.limits[:, 1], size=(n, arm.dof))


def smooth_path(arm, n, seed=0):
    """Return joint paths (n, dof) that wander through the middle nine tenths of the limits."""
    rng = np.random.default_rng(seed)
    phases = rng.uniform(0, 2 * np.pi, arm.dof) + np.linspace(0, 3, n)[:, None] * rng.uniform(0.5, 2, arm.dof)
    return arm.limits.mean(axis=1) + 0.45 * np.ptp(arm.limits, axis=1) * np.sin(phases)


def test_every_solution_reaches_the_pose(arm):
    """forward(q) = T to 1e-9 for every existing branch, in limits or not."""
    T = arm.forward(random_joints(arm, 3000))
    found = arm.solutions(T)
    assert found.exists.any(axis=1).all()
    reached, wanted = arm.forward(found.q[found.exists]), np.repeat(T, found.exists.sum(axis=1), axis=0)
    np.testing.assert_allclose(reached, wanted, atol=1e-9)


def test_the_original_joints_are_among_the_solutions(arm):
    """Joints in limits come back, roll beyond half a turn included."""
    for q in random_joints(arm, 300, seed=1):
        found = arm.inverse(arm.forward(q))
        assert np.abs(found - q).max(axis=1).min() < 1e-7
        assert arm.chain.within_limits(found, 1e-9).all()


def test_branches_are_distinct_and_flags_agree_with_the_limits(arm):
    """Existing branches differ from each other, and the limit flag is what the limits say."""
    found = arm.solutions(arm.forward(random_joints(arm, 200, seed=2)))
    np.testing.assert_array_equal(found.within_limits, found.exists & arm.chain.within_limits(found.q, 1e-9))
    assert np.isnan(found.q[~found.exists]).all()
    for q in (rows[there] for rows, there in zip(found.q, found.exists, strict=True)):
        turned = (
            np.concatenate([np.cos(q), np.sin(q)], axis=1)
            * np.where(arm.chain.revolute, 1.0, 10.0)[np.tile(np.arange(6), 2)]
        )
        apart = np.linalg.norm(turned[:, None] - turned, axis=-1) + np.eye(len(q))
        assert apart.min() > 1e-4


def test_closed_form_holds_the_numerical_solution(arm):
    """Whatever the numerical inverse finds is one of the closed-form solutions."""
    for q in random_joints(arm, 5, seed=3):
        T = arm.forward(q)
        numerical = arm.chain.inverse(T)
        assert np.abs(arm.inverse(T) - numerical).max(axis=1).min() < 1e-6


def test_full_turns_inside_the_limits_are_all_returned():
    """A PSM roll of 200 deg is also -160 deg: both keep the limits, and both come back."""
    arm = dvrk_psm()
    q = np.array([0.2, -0.3, 0.1, np.deg2rad(200.0), 0.4, -0.5])
    other = q - np.array([0, 0, 0, 2 * np.pi, 0, 0])
    found = arm.inverse(arm.forward(q))
    np.testing.assert_allclose(found[np.argsort(found[:, 3])], [other, q], atol=1e-9)


def test_out_of_limits_solutions_are_returned_on_request():
    """A pose beyond the insertion limit has no solution within limits, but has one without."""
    arm = raven2("left")
    q = arm.home + np.array([0, 0, 0.2, 0, 0, 0])
    T = arm.forward(q)
    assert arm.inverse(T).shape == (0, 6)
    assert np.abs(arm.inverse(T, within_limits=False) - q).max(axis=1).min() < 1e-9


def test_poses_at_the_remote_centre_have_an_inverse():
    """With the wrist or the yaw axis through the remote centre, to the last bit or nearly, some solution reaches."""
    arm = raven2("left")
    at_wrist = arm.forward([0.5, 1.5, 0.47, 0.3, 0.2, 0.4])
    exact, through_centre = at_wrist.copy(), np.eye(4)
    exact[:3, 3] -= arm.wrist([0.5, 1.5, 0.47, 0.3, 0.2, 0.4])
    for pose in (at_wrist, exact, through_centre):
        found = arm.solutions(pose)
        assert found.exists.any()
        reached = arm.forward(found.q[found.exists])
        np.testing.assert_allclose(reached, np.broadcast_to(pose, reached.shape), atol=1e-6)


def test_stacks_of_poses_equal_loops(arm):
    """Solutions of a (2, 3) stack are those of each pose, in the same order of branches."""
    T = arm.forward(random_joints(arm, 6, seed=4)).reshape(2, 3, 4, 4)
    stacked = arm.solutions(T)
    assert stacked.q.shape == (2, 3, 8, 6)
    for i, j in np.ndindex(2, 3):
        np.testing.assert_allclose(stacked.q[i, j], arm.solutions(T[i, j]).q, atol=1e-13)


def test_following_a_path_gives_the_joints_it_was_made_from(arm):
    """A joint path started at its own beginning is recovered from its poses alone."""
    for seed in range(3):
        q = smooth_path(arm, 150, seed)
        np.testing.assert_allclose(arm.follow(arm.forward(q), start=q[0]), q, atol=1e-6)


def test_following_begins_near_home():
    """Without a start the first solution is the one nearest to home, and an empty path stays empty."""
    arm = dvrk_psm()
    q = arm.follow(arm.forward(arm.home)[None])
    np.testing.assert_allclose(q[0], arm.home, atol=1e-12)
    assert arm.follow(np.empty((0, 4, 4))).shape == (0, 6)


def test_following_names_the_pose_it_cannot_reach():
    """A path that leaves the workspace raises with the index of the pose."""
    arm = raven2("right")
    T = arm.forward(np.tile(arm.home, (4, 1)))
    T[2, 0, 3] += 1.0
    with pytest.raises(DataError, match=r"pose 2 .* raven2_right"):
        arm.follow(T)


def test_wrong_shapes_are_refused():
    """One pose where one is meant, poses where poses are meant."""
    arm = dvrk_psm()
    with pytest.raises(DataError, match="one pose"):
        arm.inverse(np.tile(np.eye(4), (2, 1, 1)))
    with pytest.raises(DataError, match=r"\(\.\.\., 4, 4\)"):
        arm.solutions(np.eye(3))


def test_arms_without_a_remote_centre_are_refused_with_the_broken_law():
    """A shoulder offset, a shaft beside the centre and another joint order are each named."""
    psm = dvrk_psm()

    def changed(row, **values):
        joints = list(psm.chain.joints)
        old = joints[row]
        joints[row] = Joint(**{**{k: getattr(old, k) for k in old.__dataclass_fields__}, **values})
        chain = Chain(tuple(joints), "standard", psm.chain.base)
        return RemoteCentreArm("odd", chain, psm.home, psm.gravity, wrist_link=3)

    with pytest.raises(DataError, match="axes 1 and 2 meet"):
        changed(0, a=0.05)
    with pytest.raises(DataError, match="shaft passes the remote centre"):
        changed(1, a=0.05)
    with pytest.raises(DataError, match="perpendicular"):
        changed(4, alpha=0.3)
    with pytest.raises(DataError, match="offset"):
        changed(4, a=0.0)
    with pytest.raises(DataError, match="RRRRRR"):
        changed(2, kind="R")
