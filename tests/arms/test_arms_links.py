"""The published masses of the arms' links, and what counts as one."""

import numpy as np
import pytest

from gpcorrect import se3
from gpcorrect.arms import Link, arm_named
from gpcorrect.errors import DataError
from gpcorrect.sim.body import Body, Links
from gpcorrect.sim.dynamics import posture_at


@pytest.mark.parametrize("name", ["raven2_left", "raven2_right"])
def test_loads_agree_with_the_robot_own_compensation(name):
    """Its software sums moments com x m g in link frames 1 to 3 and projects on -z; joints 4 to 6 carry nothing."""
    arm = arm_named(name)
    count = len(arm.links)
    mass, com = np.array([link.mass for link in arm.links]), np.array([link.com for link in arm.links])
    links = Links(mass, com, np.zeros((count, 3)), np.zeros(1))
    body = Body(tuple(range(1, 7)), arm.joint_types, arm.chain, np.zeros(0), links, arm.gravity)
    for q in np.random.default_rng(0).uniform(arm.limits[:, 0], arm.limits[:, 1], size=(10, arm.dof)):
        frames = arm.chain.frames(q)[:3]
        holding = []
        for i, T_base_link in enumerate(frames):
            g = T_base_link[:3, :3].T @ arm.gravity
            centres = [(se3.invert(T_base_link) @ frames[k] @ [*arm.links[k].com, 1.0])[:3] for k in range(i, 3)]
            masses = [arm.links[k].mass for k in range(i, 3)]
            moment = sum(np.cross(c, m * g) for c, m in zip(centres, masses, strict=True))
            holding.append(-(sum(masses) * g if i == 2 else moment)[2])
        np.testing.assert_allclose(
            posture_at(body, q[None, None]).gravity_load()[0, 0], [*holding, 0, 0, 0], atol=1e-12
        )


def test_home_position_hangs_below_the_remote_centre():
    """At home both RAVEN-II tips and the PSM's lie on the falling side of the base origin."""
    for name in ("raven2_left", "raven2_right", "dvrk_psm"):
        arm = arm_named(name)
        assert arm.forward(arm.home)[:3, 3] @ arm.gravity > 0.5


def test_bad_masses_are_refused():
    """Negative mass, a centre that is no point."""
    with pytest.raises(DataError, match="mass"):
        Link(-1.0, np.zeros(3))
    with pytest.raises(DataError, match="centre"):
        Link(1.0, np.array([0.0, np.nan, 0.0]))
