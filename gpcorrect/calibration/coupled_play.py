"""Play of cables that pull on each other: dry friction holds each joint, coupled springs drag them.

The joints y follow what the motors ask for, q, through cables of stiffness K, and stick while the cables pull less than
friction:

    y_t = argmin_y  (q_t - y)^T K (q_t - y) / 2 + sum_i F_i |y_i - y_{t-1,i}|

With a diagonal K these are independent plays of half gap F_i / K_ii; the entries beside it turn the slack of a wrist
whose cables run over one another. The law has no clock: only the path counts (Moreau 1977, Evolution problem associated
with a moving convex set in a Hilbert space).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from scipy.optimize import least_squares

from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, FloatArray, IntArray, frozen_array

FIRST_GAP = 0.08  # half gap that learning starts from, in units of half the range; chosen by hand
GAPS = (-9.0, 1.0)  # logarithms of the half gaps that may be found, in the same units; chosen by hand
STRONGEST = 0.9  # coupling, as a correlation of stiffness; chosen by hand
LEAST_EIGENVALUE = 0.05  # of the stiffness, which must be positive definite; chosen by hand
COUPLING_PENALTY = 0.3  # standard deviations a unit: couplings that the data do not show stay near 0; chosen by hand
MOST_ROWS = 6000  # samples that are learned from: bounds the time of a fit; chosen by hand
MOST_SEARCH = 30  # evaluations of the search, likewise
SWEEPS = 30  # most sweeps of a step; chosen by hand
TOLERANCE = 1e-9  # of a step, in half ranges: far below the resolution of any encoder


@dataclass(frozen=True, eq=False)
class CoupledPlay:
    """Stiffness and friction in units of half the joints' ranges."""

    stiffness: FloatArray  # (d, d) symmetric, positive definite, unit diagonal or more
    gap: FloatArray  # (d,) half gaps F_i / K_ii

    def __post_init__(self) -> None:
        object.__setattr__(self, "stiffness", frozen_array(self.stiffness))
        object.__setattr__(self, "gap", frozen_array(self.gap))
        if self.gap.ndim != 1 or self.stiffness.shape != 2 * self.gap.shape:  # compiled code does not look
            raise DataError(f"a play with gaps {self.gap.shape} has no stiffness {self.stiffness.shape}.")

    def lags(self, path: FloatArray, new: BoolArray) -> FloatArray:
        """Return the lags `(n, d)` of the joints behind `path` (n, d); where `new`, a path starts without any.

        Parameters
        ----------
        path : (n, d) array, positions of the motors in units of half the ranges
        new : (n,) mask, where a path starts
        """
        return self.lags_and_slopes(path, new, wanted=False)[0]

    def lags_and_slopes(
        self, path: FloatArray, new: BoolArray, *, wanted: bool = True
    ) -> tuple[FloatArray, FloatArray]:
        """Return the lags `(n, d)`, and how they change with the play's numbers `(n, d, e)`.

        Those are the d half gaps, the entries of the stiffness above its diagonal (with those below), and what is added
        to its whole diagonal. Exact but where a joint is just between stick and slip.

        Parameters
        ----------
        path, new
            As for :meth:`lags`.
        wanted : bool, whether the slopes are
        """
        K, gap = np.array(self.stiffness), np.array(self.gap)  # copies: read-only arrays would be compiled for anew
        found: tuple[FloatArray, FloatArray] = _lags_and_slopes(np.ascontiguousarray(path), K, gap, new, wanted)
        return found

    def advance(self, joints: FloatArray, motors: FloatArray) -> FloatArray:
        """Return where joints `(d,)` stand after the motors have moved on to `(d,)`: one step of a live path.

        Parameters
        ----------
        joints : (d,) array, where the joints stood, in units of half the ranges
        motors : (d,) array, where the motors are now, likewise
        """
        moved = np.array(joints, dtype=np.float64)
        _drag(moved, np.array(motors, dtype=np.float64), np.array(self.stiffness), np.array(self.gap))
        return moved


def uncoupled_play(dof: int) -> CoupledPlay:
    """Return the play that a search begins at: each joint's own, of the usual gap.

    Parameters
    ----------
    dof : int, joints
    """
    return CoupledPlay(np.eye(dof), np.full(dof, FIRST_GAP))


def learn_coupled_play(
    path: FloatArray, errors: FloatArray, new: BoolArray, rows: IntArray, shown: BoolArray
) -> CoupledPlay:
    """Learn stiffness and friction, so that errors are linear in path and lags as nearly as can be.

    Weights are solved for inside each step (variable projection, Golub and Pereyra 1973).

    Parameters
    ----------
    path : (n, d) array, positions in units of half the ranges
    errors : (n, d) array, what the lags are to explain; NaN where unknown
    new : (n,) bool array, where a path starts
    rows : (k,) int array, rows whose errors may be looked at
    shown : (d,) bool array, joints whose slack this path shows; the others neither pull nor are pulled
    """
    play = uncoupled_play(path.shape[1])
    if not shown.any():
        return play
    stiffness, gap = np.array(play.stiffness), np.array(play.gap)
    found = _learned(*_thinned(path[:, shown], errors, new, rows))
    stiffness[np.ix_(shown, shown)], gap[shown] = found.stiffness, found.gap
    return CoupledPlay(stiffness, gap)


def _learned(path: FloatArray, errors: FloatArray, new: BoolArray, rows: IntArray) -> CoupledPlay:
    dof = path.shape[1]
    linear = np.hstack([np.ones((len(path), 1)), path])
    inside = linear[rows]
    left = errors[rows] - inside @ np.linalg.lstsq(inside, errors[rows], rcond=None)[0]
    wanted = errors[rows] / np.maximum(left.std(axis=0), 1e-300)
    penalty = np.hstack([np.zeros((dof * (dof - 1) // 2, dof)), COUPLING_PENALTY * np.eye(dof * (dof - 1) // 2)])

    def _residual(p: FloatArray) -> FloatArray:
        A = np.hstack([inside, _play_of(p, dof).lags(path, new)[rows]])
        return np.concatenate([(wanted - A @ np.linalg.lstsq(A, wanted, rcond=None)[0]).ravel(), penalty @ p])

    def _jacobian(p: FloatArray) -> FloatArray:
        """Of the residual, the weights' part in it too: Golub and Pereyra 1973, Eq. 5.4."""
        lags, slopes = _play_of(p, dof).lags_and_slopes(path, new)
        A, by = np.hstack([inside, lags[rows]]), slopes[rows] @ _play_slopes(p, dof)
        inverse = np.linalg.pinv(A)
        weights = inverse @ wanted
        moved = (weights[-dof:].T @ by).reshape(len(rows), -1)
        turned = np.moveaxis(np.tensordot(by, wanted - A @ weights, (0, 0)), 2, 1).reshape(dof, -1)
        moved += inverse[-dof:].T @ turned - A @ (inverse @ moved)
        return np.vstack([-moved.reshape(-1, len(p)), penalty])

    start = np.concatenate([np.full(dof, np.log(FIRST_GAP)), np.zeros(len(penalty))])
    found: Any = least_squares(_residual, start, _jacobian, max_nfev=MOST_SEARCH)
    return _play_of(found.x, dof)


def _play_of(p: FloatArray, dof: int) -> CoupledPlay:
    stiffness = _coupled(p, dof)
    least = float(np.linalg.eigvalsh(stiffness)[0])
    return CoupledPlay(stiffness + max(LEAST_EIGENVALUE - least, 0.0) * np.eye(dof), np.exp(np.clip(p[:dof], *GAPS)))


def _coupled(p: FloatArray, dof: int) -> FloatArray:
    """Stiffness `(d, d)` of unit diagonal, which need not be positive definite yet."""
    upper = np.zeros((dof, dof))
    upper[np.triu_indices(dof, 1)] = STRONGEST * np.tanh(p[dof:])
    return np.eye(dof) + upper + upper.T


def _play_slopes(p: FloatArray, dof: int) -> FloatArray:
    """Slopes `(e, p)` of a play's numbers by what the search moves: see `_play_of`."""
    upper = np.triu_indices(dof, 1)
    values, vectors = np.linalg.eigh(_coupled(p, dof))
    coupling = STRONGEST / np.cosh(p[dof:]) ** 2
    slopes = np.zeros((dof + len(coupling) + 1, len(p)))
    inside = np.clip(p[:dof], *GAPS)
    slopes[:dof, :dof] = np.diag(np.where(inside == p[:dof], np.exp(inside), 0.0))
    slopes[dof:-1, dof:] = np.diag(coupling)
    if values[0] < LEAST_EIGENVALUE:
        slopes[-1, dof:] = -2.0 * vectors[upper[0], 0] * vectors[upper[1], 0] * coupling
    return slopes


def _thinned(
    path: FloatArray, errors: FloatArray, new: BoolArray, rows: IntArray
) -> tuple[FloatArray, FloatArray, BoolArray, IntArray]:
    """Every k-th sample: the law has no clock, so a dense recording shows little more than a sparse one."""
    stride = -(-len(path) // MOST_ROWS)
    wanted = np.zeros(len(path), dtype=bool)
    wanted[rows] = True
    label = np.cumsum(new)[::stride]
    fresh = np.concatenate([[True], np.diff(label) > 0])
    return path[::stride], errors[::stride], fresh, np.flatnonzero(wanted[::stride])


@njit(cache=True)
def _drag(y: FloatArray, q: FloatArray, K: FloatArray, gap: FloatArray) -> None:
    """Move the joints `y`, in place, to where motors at `q` drag them.

    Coordinate descent from their last place: each sweep solves one joint's stick or slip exactly.
    """
    before = np.empty(len(y))
    for i in range(len(y)):
        before[i] = y[i]
    for _ in range(SWEEPS):
        change = 0.0
        for i in range(len(y)):
            pull = 0.0
            for j in range(len(y)):
                if j != i:
                    pull += K[i, j] * (q[j] - y[j])
            rest = q[i] + pull / K[i, i]
            place = min(max(before[i], rest - gap[i]), rest + gap[i])
            change = max(change, abs(place - y[i]))
            y[i] = place
        if change < TOLERANCE:
            break


@njit(cache=True)
def _lags_and_slopes(
    path: FloatArray, K: FloatArray, gap: FloatArray, new: BoolArray, wanted: bool
) -> tuple[FloatArray, FloatArray]:
    """Follow the path: a joint that sticks keeps its slopes, those that slip hang together by one law.

    Slopes are followed where they are wanted; there are none else.
    """
    dof = path.shape[1]
    lag, slopes = np.empty(path.shape), np.zeros((len(path) * wanted, dof, dof + dof * (dof - 1) // 2 + 1))
    y, before, slips = np.empty(dof), np.empty(dof), np.empty(dof, dtype=np.bool_)
    A, right = np.empty((dof, dof)), np.empty(slopes.shape[1:])
    for t in range(len(path)):
        fresh = new[t] or t == 0
        for i in range(dof):
            if fresh:
                y[i] = path[t, i]
            before[i] = y[i]
        if not new[t]:
            _drag(y, path[t], K, gap)
        for i in range(dof):
            lag[t, i] = path[t, i] - y[i]
            slips[i] = y[i] != before[i]
        if wanted and not fresh:
            _slip_law(A, right, lag[t], slips, K, slopes[t - 1])
            _solve(A, right)
            for i in range(dof):
                for e in range(right.shape[1]):
                    slopes[t, i, e] = right[i, e]
    return lag, slopes


@njit(cache=True)
def _slip_law(
    A: FloatArray, right: FloatArray, lag: FloatArray, slips: BoolArray, K: FloatArray, before: FloatArray
) -> None:
    """Write the linear law `A slopes = right` of a step: `lag_i = -sum_j K_ij lag_j / K_ii -+ gap_i` where i slips."""
    dof, n_slopes = right.shape
    for i in range(dof):
        for e in range(n_slopes):
            right[i, e] = 0.0 if slips[i] else before[i, e]
        pull, entry = 0.0, dof
        for j in range(dof):
            A[i, j] = 1.0 if j == i else (K[i, j] / K[i, i] if slips[i] else 0.0)
            pull += 0.0 if j == i else K[i, j] / K[i, i] * lag[j]
        if not slips[i]:
            continue
        for low in range(dof):
            for high in range(low + 1, dof):
                if i in (low, high):
                    right[i, entry] -= lag[high if i == low else low] / K[i, i]
                entry += 1
        right[i, i] += 1.0 if lag[i] > -pull else -1.0
        right[i, n_slopes - 1] += pull / K[i, i]


@njit(cache=True)
def _solve(A: FloatArray, right: FloatArray) -> None:
    """Put the solution of `A x = right` into `right`; both are used up. The matrix is a minimum's: no pivots."""
    for a in range(len(A)):
        for b in range(len(A)):
            factor = A[b, a] / A[a, a]
            if b != a and factor != 0.0:
                for c in range(a, len(A)):
                    A[b, c] -= factor * A[a, c]
                for e in range(right.shape[1]):
                    right[b, e] -= factor * right[a, e]
    for a in range(len(A)):
        for e in range(right.shape[1]):
            right[a, e] /= A[a, a]
