"""Laws of Denavit-Hartenberg chains: forward map, conventions, Jacobian, numerical inverse."""

import numpy as np
import pytest

from gpcorrect import se3
from gpcorrect.arms import Arm, Chain, Joint, arm_named
from gpcorrect.errors import DataError

ARMS = ["raven2_left", "raven2_right", "dvrk_psm"]


def random_joints(limits, n, seed=0):
    return np.random.default_rng(seed).uniform(limits[:, 0], limits[:, 1], size=(n, len(limits)))


def random_chain(convention, seed=0, kinds="RPRRPR"):
    rng = np.random.default_rng(seed)
    joints = tuple(Joint(kind, *rng.normal(size=4), -1.0, 1.0) for kind in kinds)
    base, tool = se3.exp(rng.normal(size=(2, 6)))
    return Chain(joints, convention, base, tool)


def test_the_two_conventions_describe_the_same_arm():
    """A standard table equals the modified one with alpha and a moved down a row and the last in the tool."""
    standard = random_chain("standard")
    rows = standard.joints
    shifted = [(0.0, 0.0), *((row.alpha, row.a) for row in rows)]
    modified = Chain(
        tuple(
            Joint(row.kind, alpha, a, row.d, row.theta, row.lower, row.upper)
            for row, (alpha, a) in zip(rows, shifted[:-1], strict=True)
        ),
        "modified",
        standard.base,
        se3.compose(Chain((Joint("R", *shifted[-1], 0.0, 0.0, -1, 1),), "standard").forward([0.0]), standard.tool),
    )
    q = random_joints(standard.limits, 30)
    np.testing.assert_allclose(modified.forward(q), standard.forward(q), atol=1e-13)
    np.testing.assert_allclose(modified.jacobian(q), standard.jacobian(q), atol=1e-13)


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_jacobian_holds_for_any_table_base_and_tool(convention):
    """The same law on random chains with prismatic joints between revolute ones."""
    h = 1e-5
    for seed in range(5):
        chain = random_chain(convention, seed)
        q = random_joints(chain.limits, 1, seed)[0]
        ahead, behind = (chain.forward(q + s * np.eye(chain.dof)) for s in (h, -h))
        linear = (ahead - behind)[:, :3, 3] / (2 * h)
        turned = se3.rotvec_from_matrix(ahead[:, :3, :3] @ np.swapaxes(behind[:, :3, :3], 1, 2)) / (2 * h)
        np.testing.assert_allclose(chain.jacobian(q), np.hstack([linear, turned]).T, atol=1e-8)


@pytest.mark.parametrize("lead", [(), (0,), (4,), (2, 3)])
def test_stacks_equal_loops(lead):
    """Forward map, frames and Jacobian of a stack are the stacks of single ones."""
    chain = random_chain("modified", seed=1)
    q = np.random.default_rng(5).normal(size=(*lead, chain.dof))
    for function in (chain.forward, chain.frames, chain.jacobian):
        stacked, tail = function(q), function(np.zeros(chain.dof)).shape
        assert stacked.shape == (*lead, *tail)
        single = [function(row) for row in q.reshape(-1, chain.dof)]
        np.testing.assert_allclose(stacked.reshape(-1, *tail), np.array(single).reshape(-1, *tail), atol=1e-15)


@pytest.mark.parametrize("name", ARMS)
def test_numerical_inverse_reaches_every_pose_in_limits(name):
    """forward(inverse(T)) = T to 1e-9 without a seed, within limits, limit corners included."""
    chain = arm_named(name).chain
    for q in [*random_joints(chain.limits, 15, seed=7), *chain.limits.T]:
        T = chain.forward(q)
        found = chain.inverse(T)
        np.testing.assert_allclose(chain.forward(found), T, atol=1e-9)
        assert chain.within_limits(found)


@pytest.mark.parametrize("name", ARMS)
def test_numerical_inverse_keeps_the_branch_of_its_seed(name):
    """Started 0.01 off, the solution is the joints the pose was made from."""
    chain = arm_named(name).chain
    inner = chain.limits + np.array([0.02, -0.02])
    for q in random_joints(inner, 10, seed=8):
        np.testing.assert_allclose(chain.inverse(chain.forward(q), seed=q + 0.01), q, atol=1e-7)


def test_following_numerically_keeps_to_its_path():
    """Pose after pose from the posture before: the joints of a path that the poses were made from, never a branch."""
    plain = {name: getattr(arm_named("dvrk_psm"), name) for name in ("name", "chain", "home", "gravity")}
    arm, rng = Arm(**plain), np.random.default_rng(0)
    phase = np.linspace(0, 3, 200)[:, None] * rng.uniform(0.5, 2.0, 6)
    path = arm.limits.mean(axis=1) + 0.4 * np.ptp(arm.limits, axis=1) * np.sin(phase)
    np.testing.assert_allclose(arm.follow(arm.forward(path), path[0]), path, atol=1e-7)


def test_numerical_inverse_says_how_far_a_pose_is_out_of_reach():
    """A pose 5 m away raises and names the miss; so do a shape that is no pose and a seed of another arm."""
    chain = arm_named("dvrk_psm").chain
    far = np.eye(4)
    far[0, 3] = 5.0
    with pytest.raises(DataError, match=r"misses it by 4\.\d+ m"):
        chain.inverse(far)
    with pytest.raises(DataError, match="finite"):
        chain.inverse(np.full((4, 4), np.nan))
    with pytest.raises(DataError, match="seed"):
        chain.inverse(np.eye(4), seed=[0.0, 0.0])


def test_limits_are_kept_and_margins_widen_them():
    """A joint on its limit is inside; beyond it only a margin lets it pass."""
    chain = random_chain("standard")
    q = np.zeros((3, 6))
    q[:, 2] = 1.0, 1.01, np.nan
    np.testing.assert_array_equal(chain.within_limits(q), [True, False, False])
    np.testing.assert_array_equal(chain.within_limits(q, margin=0.02), [True, True, False])
    assert chain.joint_types == "RPRRPR"


def test_bad_tables_are_refused():
    """Unknown kinds, conventions, limits and shapes raise where they enter."""
    with pytest.raises(DataError, match="revolute"):
        Joint("X", 0, 0, 0, 0, -1, 1)
    for lower, upper in [(1, 1), (2, 1), (-np.inf, 1), (0, np.nan)]:
        with pytest.raises(DataError, match="limits"):
            Joint("R", 0, 0, 0, 0, lower, upper)
    with pytest.raises(DataError, match="convention"):
        Chain((Joint("R", 0, 0, 0, 0, -1, 1),), "craig")
    with pytest.raises(DataError, match="at least one"):
        Chain((), "standard")
    with pytest.raises(DataError, match="tool"):
        Chain((Joint("R", 0, 0, 0, 0, -1, 1),), "standard", tool=np.eye(3))
    with pytest.raises(DataError, match=r"\(\.\.\., 6\)"):
        random_chain("standard").forward(np.zeros(5))


def test_a_chain_keeps_its_own_copy():
    """Changing the base given to a chain does not move it, and its arrays cannot be written."""
    base = np.eye(4)
    chain = Chain((Joint("R", 0, 0.1, 0, 0, -1, 1),), "standard", base=base)
    base[0, 3] = 9.0
    assert chain.forward([0.0])[0, 3] == pytest.approx(0.1)
    with pytest.raises(ValueError, match="read-only"):
        chain.base[0, 3] = 1.0


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize("shape", [(), (1,), (7,), (3, 4), (0,)])
def test_frames_are_products_of_the_tables_four_motions(convention, shape):
    """Each link's frame is the one before it, moved as its row says; the tip is the last one and the tool."""
    chain = random_chain(convention, seed=5)
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (*shape, chain.dof))
    frames, tips = chain.frames(q), chain.forward(q)
    assert (frames.shape, tips.shape) == ((*shape, chain.dof, 4, 4), (*shape, 4, 4))
    for index in np.ndindex(*shape):
        T = chain.base
        for i, row in enumerate(chain.joints):
            value = q[(*index, i)]
            theta, d = row.theta + value * (row.kind == "R"), row.d + value * (row.kind == "P")
            x = se3.exp(np.array([row.a, 0, 0, row.alpha, 0, 0]))  # turn and shift along one axis commute
            z = se3.exp(np.array([0, 0, d, 0, 0, theta]))
            T = T @ z @ x if convention == "standard" else T @ x @ z
            np.testing.assert_allclose(frames[(*index, i)], T, atol=1e-12)
        np.testing.assert_allclose(tips[index], T @ chain.tool, atol=1e-12)
