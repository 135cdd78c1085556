"""The linear law of every joint, with a prior: what a cable does to its joint, it tells in its own effort.

Along one straight stripe all joints turn back together, and their efforts and slacks cannot be told apart; a law
without a prior spreads one joint's friction over all of them, and is wrong wherever joints move on their own, or under
another load. So where efforts are logged, those of other joints, and what is remembered, have to earn their weights.
"""

from __future__ import annotations

import numpy as np

from gpcorrect.joint import JointFeatures, PolynomialMap
from gpcorrect.joint.maps import Scaler, polynomial_terms
from gpcorrect.types import FloatArray

__all__ = ["linear_law"]

# Penalties on the square of a weight, in units of the samples, for features and errors of unit spread.
PLAIN = 1e-5
REMEMBERED = 1e-2
OTHERS = 0.3


def linear_law(X: FloatArray, Y: FloatArray, features: JointFeatures) -> PolynomialMap:
    """Return the ridge regression of errors `(n, d)` on features `(n, k)`, each joint's with its own penalties."""
    scaler = Scaler.of(X)
    A = polynomial_terms(scaler.apply(X), 1)
    gram, right = A.T @ A, A.T @ Y
    weights = np.empty(right.shape)
    for joint in range(Y.shape[1]):
        penalty = np.concatenate([[0.0], _penalties(features, joint)])  # the offset is free
        weights[:, joint] = np.linalg.solve(gram + len(A) * np.diag(penalty), right[:, joint])
    std: FloatArray = (Y - A @ weights).std(axis=0)
    return PolynomialMap(1, scaler, weights, std)


def _penalties(features: JointFeatures, joint: int) -> FloatArray:
    """Penalties `(k,)` of the features' weights in the law of a joint."""
    kinds, owners = features.origins
    penalties = np.full(len(kinds), PLAIN)
    if "effort" not in features.kinds:
        return penalties
    past = np.isin(kinds, ("velocity", "memory"))
    penalties[past] = REMEMBERED
    penalties[(past | (kinds == "effort")) & (owners != joint)] = OTHERS
    return penalties
