"""How much an effect's size differs from trajectory to trajectory: noise lets it, a machine does not."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from gpcorrect.discrepancy.naming.intervals import columns_of
from gpcorrect.discrepancy.search.candidates import FittedEffect
from gpcorrect.discrepancy.search.state import Search
from gpcorrect.discrepancy.settings import NAMING
from gpcorrect.types import FloatArray


def size_overdispersion(search: Search, fit: FittedEffect) -> float:
    """Return how much more an effect's size differs between trajectories than noise lets it, 1 at least.

    Noise that wanders slowly gives every trajectory a size of its own; nats counted sample by sample do not know that.
    Each trajectory's score along the signature, in its standard deviations, has a mean square of one; what the sum of
    squares is above its 95 % quantile says by how much evidence counts less.

    Parameters
    ----------
    search : Search
    fit : FittedEffect, one of the set
    """
    score, energy = _scores(search, fit)
    if not len(energy):
        return 1.0
    return max(1.0, float((score**2 / energy).sum() / chi2.ppf(0.95, len(energy))))


def size_spread(search: Search, fit: FittedEffect) -> float:
    """Return the standard deviation of an effect's size between trajectories, beyond noise, as a part of the size.

    What a part of a machine is or does is the same in every motion. 0 where noise may be all of the difference (0.1 %
    level).

    Parameters
    ----------
    search : Search
    fit : FittedEffect, one of the set

    Notes
    -----
    DerSimonian and Laird 1986, Controlled Clinical Trials 7(3), Eq. 8.
    """
    score, energy = _scores(search, fit)
    freedom, change = len(energy) - 1, score / energy
    if freedom < NAMING.few - 1:
        return 0.0
    differs = float(energy @ (change - np.average(change, weights=energy)) ** 2)
    if differs < chi2.isf(NAMING.chance_of_spread, freedom):
        return 0.0
    return float(np.sqrt((differs - freedom) / (energy.sum() - (energy**2).sum() / energy.sum())))


def _scores(search: Search, fit: FittedEffect) -> tuple[FloatArray, FloatArray]:
    """Score along the relative size of an effect, and its information, of each trajectory in which the effect acts."""
    linearised, candidate = search.linearise_near(search.fitted, fit.candidate), fit.candidate
    near, sizes = search.parted(search.fitted, candidate)[1], list(candidate.sizes)
    size = np.array([fit.u[i] - candidate.coordinates[i].identity for i in sizes])
    size = np.where(np.isfinite(size), size, 1.0)  # the logarithm of a size is relative already
    own = linearised.slopes[:, columns_of(near, fit)[sizes]] @ size
    block = search.whitener.block
    energy, score = np.bincount(block, own**2), np.bincount(block, own * linearised.z)
    active = energy > NAMING.active * energy.max(initial=0.0)
    return score[active], energy[active]
