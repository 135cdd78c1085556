"""The learners together, each target by the mixture that predicts left-out trajectories best.

Weights are not negative and sum to one (stacked regression, Breiman 1996), so that no mixture is more than its members
say, and what all of them say stays. They are found on the predictions of samples that no member was fitted to, which
are the ones that the intervals rest on too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np
from scipy.optimize import nnls

from gpcorrect.calibration.dataset import Layout, Samples
from gpcorrect.calibration.learners.gp import GPMap, learn_gp
from gpcorrect.calibration.learners.learner import Fitted, Learner
from gpcorrect.calibration.learners.polynomial import PolynomialMap, learn_polynomial
from gpcorrect.calibration.learners.trees import TreesMap, learn_trees
from gpcorrect.calibration.settings import FitSettings
from gpcorrect.gpr import LeftOut
from gpcorrect.types import FloatArray, Progress

ONE = 1e3
"""Weight of the sum of the weights, beside errors of unit mean square: a sum off by 1e-6 costs as much as the noise."""

UNSEEN = 1e9  # penalty of a column that a law is not to see: its weight is a billionth of what it would be


@dataclass(frozen=True, eq=False)
class MixedMap:
    """A weighted mean of maps, and the deviations and novelty of the Gaussian process among them."""

    gp: GPMap  # which also says where it knows nothing
    others: tuple[TreesMap | PolynomialMap | GPMap, ...]  # the other k - 1
    weights: FloatArray  # (k, m) of each, the Gaussian process first; columns sum to 1
    extrapolates: ClassVar[bool] = True  # the linear law does

    def predict(self, X: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See :class:`TargetMap`."""
        mean, std, novelty = self.gp.predict(X)
        return _sum(self.weights, [mean, *(other.predict(X)[0] for other in self.others)]), std, novelty


def learn_mixture(samples: Samples, layout: Layout, settings: FitSettings, progress: Progress) -> Fitted:
    """Learn a :class:`MixedMap` of the Gaussian process, trees, and a line.

    Of joints, whose learners have a law first: trees without it, and a Gaussian process without the past for the line.
    """
    members: list[tuple[Learner, Layout]] = [(learn_gp, layout), (learn_trees, layout)]
    if layout.penalties is None:
        members.append((partial(learn_polynomial, 1), layout))
    else:
        members += [(learn_gp, _without_past(layout)), (learn_trees, replace(layout, penalties=None))]
    gp, *others = (learn(samples, own, settings, progress) for learn, own in members)
    errors = [part.left_out.errors for part in (gp, *others)]
    weights = _stacking_weights(errors)
    left_out = LeftOut(_sum(weights, errors), gp.left_out.std, gp.left_out.novelty)
    moved = [(weight, part) for weight, part in zip(weights, (gp, *others), strict=True) if part.zero is not None]
    zero, foretold = (
        sum(weight * getattr(part, name) for weight, part in moved) if moved else None for name in ("zero", "foretold")
    )
    return Fitted(MixedMap(gp.learned, tuple(part.learned for part in others), weights), left_out, zero, foretold)


def _without_past(layout: Layout) -> Layout:
    """Return the layout of a law of positions and efforts and a field of positions.

    An error that goes by the pose alone: slacks, lags and velocities, which say nothing of it, keep the samples of a
    few trajectories apart in the field, and the law finds chance in them. A field of efforts would end at a load above
    all that was recorded.
    """
    assert layout.penalties is not None
    penalties = layout.penalties.copy()
    penalties[np.setdiff1d(np.arange(len(penalties)), layout.present)] = UNSEEN
    return replace(layout, smooth=layout.place, penalties=penalties)


def _stacking_weights(errors: list[FloatArray]) -> FloatArray:
    """Return weights `(k, m)`, not negative and summing to 1, under which k left-out errors `(n, m)` are smallest."""
    columns = np.stack(errors, axis=-1)
    weights = []
    for part in np.moveaxis(columns, 1, 0):
        scaled = part / np.sqrt(np.mean(part**2) * len(part))
        to_one = np.full((1, part.shape[1]), ONE)
        found, _ = nnls(np.vstack([scaled, to_one]), np.append(np.zeros(len(part)), ONE))
        weights.append(found / found.sum())
    return np.array(weights).T


def _sum(weights: FloatArray, parts: Sequence[FloatArray]) -> FloatArray:
    """Return the weighted sum `(n, m)` of k parts `(n, m)` under weights `(k, m)`."""
    return np.asarray(np.einsum("km,knm->nm", weights, np.stack(parts)))
