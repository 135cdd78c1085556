"""From a pose to the joints that take the arm there, learned from the log's own commands: no model of the arm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from gpcorrect.calibration.poses import rotations_of
from gpcorrect.gpr import FeatureMap, Predictor, SparseGPR
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

__all__ = ["JointMap"]

SOURCES = (("setpoint_cp", "setpoint_jp"), ("measured_cp", "measured_jp"))  # pairs that one kinematics made
MOST_SAMPLES = 4000  # bounds the time of a fit; chosen by hand
FEWEST_SAMPLES = 60  # below which no map is learned; chosen by hand
INDUCING = 400  # points of the Gaussian process; chosen by hand
# Of the variance of a joint that poses left out must explain: a gripper or a redundant joint is not determined by the
# pose; chosen by hand.
LEAST_EXPLAINED = 0.9


@dataclass(frozen=True, eq=False)
class JointMap:
    """Inverse kinematics by regression: the joints that a pose determines.

    Parameters
    ----------
    features : FeatureMap
        Of poses in the command's frame.
    predictor : Predictor
        Joints, rad or m.
    determined : tuple of int
        Which joints the pose determines; the others are left out.
    """

    features: FeatureMap
    predictor: Predictor
    determined: tuple[int, ...]

    @classmethod
    def fit(cls, log: CalibrationLog, seed: int, *, orientation: bool) -> Self | None:
        """Learn from commanded, else reported poses and joints; None where there are none or poses determine none.

        Without `orientation` positions alone must determine the joints.

        Parameters
        ----------
        log : CalibrationLog
            Holds poses and joints.
        seed : int
            Of the samples and inducing points that are drawn.
        orientation : bool
            Whether orientations may be used.
        """
        for pose_name, joint_name in SOURCES:
            poses, joints = getattr(log, pose_name), getattr(log, joint_name)
            if poses is not None and joints is not None:
                poses = poses if orientation else PoseSignal(poses.position)
                rows = np.flatnonzero(poses.finite & np.isfinite(joints).all(axis=1))
                if len(rows) >= FEWEST_SAMPLES:
                    return cls._learn(poses[rows], joints[rows], np.random.default_rng(seed))
        return None

    @classmethod
    def _learn(cls, poses: PoseSignal, joints: FloatArray, rng: np.random.Generator) -> Self | None:
        rows = rng.permutation(len(poses))[:MOST_SAMPLES]
        poses, joints = poses[rows], joints[rows]
        features = FeatureMap(("pose",)).fit(poses.position, rotations_of(poses), None)
        X = features.transform(poses.position, rotations_of(poses))
        regressor = SparseGPR(n_inducing=INDUCING, n_variance=1, random_state=int(rng.integers(2**31 - 1)))
        learned, count = regressor.fit(X, joints), len(X) * 3 // 4
        guess = learned.refit(X[:count], joints[:count]).predict(X[count:])
        left = ((joints[count:] - guess.reshape(len(X) - count, -1)) ** 2).mean(axis=0)
        determined = np.flatnonzero((left <= (1 - LEAST_EXPLAINED) * joints.var(axis=0)) & (joints.var(axis=0) > 0))
        return cls(features, learned.predictor_, tuple(determined.tolist())) if determined.size else None

    def __call__(self, position: FloatArray, rotations: FloatArray | None) -> FloatArray:
        """Return joints `(n, k)` of positions `(n, 3)` and rotations `(n, 3, 3)`."""
        X = self.features.transform(position, rotations)
        return self.predictor.mean_std_batch(X)[0][:, list(self.determined)]
