"""The linear law's prior: a joint's own effort tells what its cable does."""

from __future__ import annotations

import numpy as np
from joint_logs import joint_log

from gpcorrect.joint import JointFeatures, joint_data
from gpcorrect.joint_corrector.law import law_penalties, linear_law

STRETCH = np.array([0.02, -0.01, 0.001])  # of each joint's own effort, rad and m for each unit


def test_efforts_that_go_together_are_laid_to_their_own_joint() -> None:
    """Trained where all joints turn back together, the law holds where they do not."""
    data = joint_data(joint_log(1, trajectories=4))
    features = JointFeatures.learn(("position", "effort"), data, np.arange(len(data)))
    rng = np.random.default_rng(0)
    place = rng.uniform(-1, 1, (len(data), 3))
    together = np.sign(rng.standard_normal((len(data), 1))) + 0.05 * rng.standard_normal((len(data), 3))
    noise = 0.1 * STRETCH * rng.standard_normal((len(data), 3))
    law = linear_law(np.hstack([place, together]), together * STRETCH + noise, law_penalties(features))
    apart = np.sign(rng.standard_normal((len(data), 3)))
    error = apart * STRETCH - law.predict(np.hstack([place, apart]))[0]
    assert (np.sqrt((error**2).mean(axis=0)) < 0.1 * np.abs(STRETCH)).all()


def test_without_efforts_joints_may_pull_on_each_other() -> None:
    """Where nothing else tells, the slack of one joint may explain the error of another in full."""
    data = joint_data(joint_log(2, trajectories=4))
    features = JointFeatures.learn(("position", "memory"), data, np.arange(len(data)))
    X = features.transform(data)
    weights = np.zeros((X.shape[1], 3))
    weights[4, 0] = 1.0  # the second joint's lag in the first joint's error
    found = linear_law(X, X @ weights, law_penalties(features)).predict(X)[0]
    np.testing.assert_allclose(found, X @ weights, atol=1e-4 * np.abs(X[:, 4]).max())
