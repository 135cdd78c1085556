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

__all__ = ["law_penalties", "linear_law"]

# Penalties on the square of a weight, in units of the samples, for features and errors of unit spread.
PLAIN = 1e-5
REMEMBERED = 1e-2
OTHERS = 0.3


def linear_law(X: FloatArray, Y: FloatArray, penalties: FloatArray | None = None) -> PolynomialMap:
    """Return the ridge regression of errors `(n, m)` on features `(n, k)`, with penalties `(k, m)` of the weights."""
    if penalties is None:
        penalties = np.full((X.shape[1], Y.shape[1]), PLAIN)
    scaler = Scaler.of(X)
    A = polynomial_terms(scaler.apply(X), 1)
    gram, right = A.T @ A, A.T @ Y
    weights = np.empty(right.shape)
    for joint, penalty in enumerate(penalties.T):
        system = gram + len(A) * np.diag(np.concatenate([[0.0], penalty]))  # the offset is free
        weights[:, joint] = np.linalg.solve(system, right[:, joint])
    std: FloatArray = (Y - A @ weights).std(axis=0)
    return PolynomialMap(1, scaler, weights, std)


def law_penalties(features: JointFeatures) -> FloatArray:
    """Return the penalties `(k, d)` of the features' weights in the law of each joint."""
    kinds, owners = features.origins
    penalties = np.full((len(kinds), len(features.centre)), PLAIN)
    if "effort" not in features.kinds:
        return penalties
    past = np.isin(kinds, ("velocity", "memory"))
    penalties[past] = REMEMBERED
    foreign = owners[:, None] != np.arange(len(features.centre))
    penalties[(past | (kinds == "effort"))[:, None] & foreign] = OTHERS
    return penalties
