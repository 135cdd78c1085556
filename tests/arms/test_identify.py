"""Laws of kinematics learned from a recording: it is that of the arm, and what is no arm is refused."""

from __future__ import annotations

import numpy as np
import pytest

from gpcorrect import se3
from gpcorrect.arms import Chain, Joint, arm_named, identify_chain, workspace
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.types import FloatArray


def postures(chain: Chain, n: int = 300, seed: int = 0, share: float = 0.5) -> FloatArray:
    """Return random joints inside the middle `share` of the limits."""
    low, high = chain.limits.T
    middle, half = (low + high) / 2, share * (high - low) / 2
    return middle + half * np.random.default_rng(seed).uniform(-1, 1, (n, chain.dof))


def random_chain(seed: int, types: str) -> Chain:
    """Return a chain whose joints lie anyhow."""
    rng = np.random.default_rng(seed)
    limits = {"R": 1.0, "P": 0.1}
    joints = tuple(
        Joint("R" if kind == "R" else "P", *rng.uniform(-1, 1, 4) * [2, 0.2, 0.2, 3], -limits[kind], limits[kind])
        for kind in types
    )
    return Chain(joints, "standard")


@pytest.mark.parametrize("name", ["raven2_left", "dvrk_psm"])
def test_the_chain_of_a_known_arm_is_found_from_its_poses(name: str) -> None:
    """At postures that were not in the recording too, to a nanometre."""
    chain = arm_named(name).chain
    q, other = postures(chain), postures(chain, seed=1, share=0.9)
    found = identify_chain(q, chain.forward(q), chain.joint_types)
    np.testing.assert_allclose(found.forward(other), chain.forward(other), atol=1e-9)


@pytest.mark.parametrize(("seed", "types"), [(0, "RRR"), (1, "RPR"), (2, "RRRR"), (3, "PRRRR"), (4, "RRRRRR")])
def test_any_serial_chain_is_found(seed: int, types: str) -> None:
    """Axes that lie anyhow, revolute and prismatic."""
    chain = random_chain(seed, types)
    q, other = postures(chain, share=0.8), postures(chain, seed=1)
    found = identify_chain(q, chain.forward(q), types)
    np.testing.assert_allclose(found.forward(other), chain.forward(other), atol=1e-8)


def test_files_that_round_their_numbers_are_enough() -> None:
    """With hundredths of a millimetre and of a degree in the file the chain errs by no more than these."""
    chain = arm_named("dvrk_psm").chain
    q = postures(chain)
    T = chain.forward(q)
    T[:, :3, 3] = np.round(T[:, :3, 3], 5)
    T[:, :3, :3] = se3.matrix_from_rotvec(np.round(se3.rotvec_from_matrix(T[:, :3, :3]), 4))
    off = identify_chain(q, T, chain.joint_types).forward(q)[:, :3, 3] - chain.forward(q)[:, :3, 3]
    assert np.abs(off).max() < 1e-5


def test_poses_that_no_chain_makes_are_refused() -> None:
    """Poses of other joints, and joint types that are not the arm's, are told from rounding."""
    chain = arm_named("dvrk_psm").chain
    q = postures(chain)
    with pytest.raises(DataError, match="misses them by"):
        identify_chain(np.random.default_rng(3).permutation(q), chain.forward(q), chain.joint_types)
    with pytest.raises(DataError, match="joint_types"):
        identify_chain(q, chain.forward(q), "RRRRRR")


def test_a_joint_that_stands_still_shows_no_axis() -> None:
    """And few samples show none at all."""
    chain = arm_named("dvrk_psm").chain
    q = postures(chain)
    q[:, 3] = 0.2
    with pytest.raises(DegenerateError, match="in which all move"):
        identify_chain(q, chain.forward(q), chain.joint_types)
    with pytest.raises(DegenerateError, match="10 samples"):
        identify_chain(postures(chain, 10), chain.forward(postures(chain, 10)), chain.joint_types)


def test_the_nearest_joints_reach_the_pose() -> None:
    """From a third of a radian away Newton's method comes back, or says that it did not."""
    chain = arm_named("raven2_left").chain
    q, rng = postures(chain, 500, share=0.4), np.random.default_rng(2)
    T = chain.forward(q)
    away = q + rng.uniform(-1, 1, q.shape) * np.where(chain.revolute, 0.3, 0.02)
    found, left = chain.nearest(T, away, workspace(T))
    reached = left < 1e-6
    assert reached.mean() > 0.99
    np.testing.assert_allclose(chain.forward(found[reached]), T[reached], atol=1e-7)
    assert (np.abs(found - q)[reached].max(axis=1) < 1e-6).mean() > 0.98


def test_a_pose_out_of_reach_leaves_an_error() -> None:
    """An arm of five joints comes near a pose that is turned away, and what is left says that it does not reach it."""
    chain = arm_named("dvrk_psm").chain
    five = Chain(chain.joints[:5], chain.convention, chain.base)
    q = postures(five, 20, share=0.3)
    turned = se3.pose(se3.matrix_from_rotvec(np.array([0.1, 0.05, 0.2])), np.zeros(3))
    found, left = five.nearest(five.forward(q) @ turned, q, 0.1)
    assert np.isfinite(found).all()
    assert (left > 0.005).all()
    assert (five.nearest(five.forward(q), q, 0.1)[1] < 1e-6).all()
