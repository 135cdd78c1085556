"""What an effect's further numbers cost: Occam's factor, as far as the data ask for them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import comb
from scipy.stats import chi2

from gpcorrect.discrepancy.evidence.linear import solve
from gpcorrect.discrepancy.naming.intervals import columns_of
from gpcorrect.discrepancy.search.candidates import FittedEffect
from gpcorrect.discrepancy.search.linearisation import linearise
from gpcorrect.discrepancy.search.state import Search
from gpcorrect.discrepancy.settings import SEARCH
from gpcorrect.types import FloatArray


def price_of(search: Search, fitted: Sequence[FittedEffect], fit: FittedEffect, noisier: float) -> float:
    """Return the nats that an effect's further numbers cost.

    Of several sizes of either sign those cost nothing that the data do not ask for, but that it could as well have been
    others is paid for: a centre of mass that is off along one axis is one number, of three.

    Parameters
    ----------
    search : Search
    fitted : sequence of FittedEffect, a set
    fit : FittedEffect, one of it
    noisier : float, by how much evidence counts less
    """
    candidate = fit.candidate
    sizes = [
        places
        for places in candidate.places.values()  # several where there is a value a session
        if places[0] in candidate.sizes and candidate.coordinates[places[0]].prior_weight > 0.0
    ]
    if len(sizes) < 2:
        return SEARCH.complexity * candidate.extra
    slopes = own_slopes(search, fitted, fit)
    asked, change, idle = set(range(len(fit.u))), slopes @ fit.u, 0
    while idle < len(sizes) - 1:
        rest = [sorted(asked - set(places)) for places in sizes if asked >= set(places)]
        left = [change - slopes[:, r] @ factors_of(slopes[:, r], change) for r in rest]
        lost = [float(z @ z) for z in left]
        if min(lost) > chi2.ppf(0.95, len(fit.u) - len(rest[0])) * noisier:
            break
        idle, asked = idle + 1, set(rest[int(np.argmin(lost))])
    return SEARCH.complexity * (candidate.extra - idle) + float(np.log(comb(len(sizes), idle)))


def shape_evidence(search: Search, fitted: Sequence[FittedEffect]) -> float:
    """Return what the shape of a set's last effect costs in evidence: how much narrower the data make what it may be.

    Occam's factor of a normal posterior (MacKay 2003, Information Theory, Inference and Learning, Eq. 28.6); sizes
    beyond the first cost what they always do.
    Infinite where the shape is at the end of its range, or does not show: there a fuller law says what its special case
    says.

    Parameters
    ----------
    search : Search
    fitted : sequence of FittedEffect, a set
    """
    fit, candidate = fitted[-1], fitted[-1].candidate
    near = search.parted(fitted, candidate)[1]
    slopes = search.linearise_near(fitted, candidate).slopes
    prior = np.array([c.prior_weight for f in near for c in f.candidate.coordinates])
    known = np.linalg.pinv(slopes.T @ slopes + np.diag(prior**2), hermitian=True)
    sizes = sum(places[0] in candidate.sizes for places in candidate.places.values())
    nats, own = SEARCH.complexity * (sizes - 1), columns_of(near, fit)
    for i, c in enumerate(candidate.coordinates):
        if i in candidate.sizes:
            continue
        low, high = c.bounds
        spread = float(np.sqrt(known[own[i], own[i]]))
        if spread == 0.0 or not low + SEARCH.edge * (high - low) < fit.u[i] < high - SEARCH.edge * (high - low):
            return np.inf
        if c.prior_weight:  # normal, around what is typical
            nats += 0.5 * (c.prior_weight * fit.u[i]) ** 2 - np.log(c.prior_weight * spread)
        else:  # anything within its bounds
            nats += max(0.0, np.log(c.width / (np.sqrt(2.0 * np.pi) * spread)))
    return nats


def own_slopes(search: Search, fitted: Sequence[FittedEffect], fit: FittedEffect) -> FloatArray:
    """Return the whitened tangents `(M, p)` of one effect of a set, less what the others of the set can take up.

    Parameters
    ----------
    search : Search
    fitted : sequence of FittedEffect, the set
    fit : FittedEffect, one of it
    """
    rest = [m for m in fitted if m is not fit]
    slopes = linearise(search.whitener, [fit], rest).slopes
    others = search.linearise_near(rest, fit.candidate).slopes
    basis = np.linalg.qr(others)[0] if others.shape[1] else others
    return np.asarray(slopes - basis @ (basis.T @ slopes))


def linear_evidence(
    slopes: FloatArray, numbers: FloatArray, change: FloatArray, misfit: float, noisier: float
) -> float:
    """Return an effect's log evidence as a linear model with a normal prior, as wide as its part in a change asks for.

    Bishop 2006, Eq. 3.86; the prior's mean square is that of the numbers' part in the change.

    Parameters
    ----------
    slopes : (M, p) array, from :func:`own_slopes`
    numbers : (p,) array, where the effect is
    change : (M,) array
    misfit : float, half the sum of squares that its set leaves
    noisier : float, by how much evidence counts less
    """
    size = float(np.mean(factors_of(slopes, change) ** 2))
    if not size > 0.0:  # others take up all that it changes
        return -np.inf
    precision = slopes.T @ slopes / noisier + np.eye(slopes.shape[1]) / size
    prior = 0.5 * float(numbers @ numbers) / size
    return -misfit / noisier - prior - 0.5 * float(np.linalg.slogdet(size * precision)[1])


def factors_of(columns: FloatArray, change: FloatArray) -> FloatArray:
    """Return the factors `(p,)` of columns `(M, p)` that explain most of a change `(M,)`.

    Parameters
    ----------
    columns, change : arrays
    """
    return solve(columns.T @ columns, columns.T @ change)
