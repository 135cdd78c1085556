"""The linear law's prior: a joint's own effort tells what its cable does."""

from __future__ import annotations

import numpy as np
from joint_logs import joint_log

from gpcorrect.calibration.joint_features import JointFeatures, law_penalties
from gpcorrect.calibration.joint_path import JointPath, joint_path
from gpcorrect.calibration.learners import PolynomialMap
from gpcorrect.types import FloatArray

STRETCH = np.array([0.02, -0.01, 0.001])  # of each joint's own effort, rad and m for each unit


def a_path(seed: int) -> tuple[JointPath, FloatArray]:
    """Return the path of a small recording, and its errors."""
    log = joint_log(seed, trajectories=4)
    return joint_path(log.time, log.session, log.measured_jp, log.measured_jf), log.external_jp - log.measured_jp


def test_efforts_that_go_together_are_laid_to_their_own_joint() -> None:
    """Trained where all joints turn back together, the law holds where they do not."""
    path, error = a_path(1)
    n = len(path.time)
    features = JointFeatures.learn(("position", "effort"), path, error, np.arange(n))
    rng = np.random.default_rng(0)
    place = rng.uniform(-1, 1, (n, 3))
    together = np.sign(rng.standard_normal((n, 1))) + 0.05 * rng.standard_normal((n, 3))
    noise = 0.1 * STRETCH * rng.standard_normal((n, 3))
    penalties = law_penalties(features, 3, owned=True)
    law = PolynomialMap.fit(np.hstack([place, together]), together * STRETCH + noise, 1, penalties)
    apart = np.sign(rng.standard_normal((n, 3)))
    left = apart * STRETCH - law.mean(np.hstack([place, apart]))
    assert (np.sqrt((left**2).mean(axis=0)) < 0.1 * np.abs(STRETCH)).all()


def test_without_efforts_joints_may_pull_on_each_other() -> None:
    """Where nothing else tells, the slack of one joint may explain the error of another in full."""
    path, error = a_path(2)
    features = JointFeatures.learn(("position", "memory"), path, error, np.arange(len(path.time)))
    X = features.transform(path)
    weights = np.zeros((X.shape[1], 3))
    weights[4, 0] = 1.0  # the second joint's lag in the first joint's error
    found = PolynomialMap.fit(X, X @ weights, 1, law_penalties(features, 3, owned=True)).mean(X)
    np.testing.assert_allclose(found, X @ weights, atol=1e-4 * np.abs(X[:, 4]).max())
