"""Robust Gauss-Newton on the two rotations, the translation and the lever arm of a marker model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gpcorrect import se3
from gpcorrect.rigid.registration import cauchy_loss, cauchy_weights, component_scale
from gpcorrect.types import FloatArray

GENERATORS = se3.hat(np.eye(3))  # GENERATORS[k] @ v = e_k x v
SCALE_ROUNDS, KNOWN_ROUNDS = 5, 2  # of robust scales, and from a start that has them nearly right; chosen by hand
MAX_STEPS = 60  # Gauss-Newton ends by its tolerance before
MAX_HALVINGS = 12  # a step 4000 times shorter that does not help is no descent
STEP_TOLERANCE = 1e-11  # rad and m: below what any sensor sees
COARSE_TOLERANCE = 1e-6  # the same while the scales still change, or kinds are compared: below any noise
LEAST_SCALE = 1e-6  # of the spread of the points, and rad: keeps exact positions from silencing rotations
CONDITION = 1e-14  # of the normal equations: weaker directions are not determined and stay as they are


class MarkerState(NamedTuple):
    """The unknowns of `u = R (p + R_obs offset) + t` and `R_cmd = R R_obs R_right`."""

    R: FloatArray
    t: FloatArray
    R_right: FloatArray
    offset: FloatArray

    def moved(self, step: FloatArray) -> MarkerState:
        """State after a step `(12,)`: turn of R on the left, of t, of R_right on the right, of the offset.

        Parameters
        ----------
        step : (12,) array, turn of R (rad), t (m), turn of R_right (rad), offset (m)
        """
        return MarkerState(
            se3.matrix_from_rotvec(step[:3]) @ self.R,
            self.t + step[3:6],
            self.R_right @ se3.matrix_from_rotvec(step[6:9]),
            self.offset + step[9:],
        )


@dataclass(frozen=True, eq=False)
class Samples:
    """What is to be explained; an absent part (None) puts no demand on the unknowns."""

    R_obs: FloatArray  # (n, 3, 3) observed rotations
    # (n, 3) observed and commanded positions, each about its own centre, m
    p: FloatArray | None = None
    u: FloatArray | None = None
    R_cmd: FloatArray | None = None  # (n, 3, 3) commanded rotations


def refine(samples: Samples, start: MarkerState, *, known: bool = False) -> tuple[MarkerState, float]:
    """State of least Cauchy loss near `start`, and the loss.

    Positions and rotations are each measured in units of their own robust scale, which follows the fit.

    Parameters
    ----------
    samples : Samples
    start : MarkerState
    known : bool
        Whether the start solves nearly the same samples, and the end is only to be compared: few rounds, and steps
        below any noise end them.
    """
    state, rounds = start, KNOWN_ROUNDS if known else SCALE_ROUNDS
    for tolerance in (*[COARSE_TOLERANCE] * (rounds - 1), COARSE_TOLERANCE if known else STEP_TOLERANCE):
        state = _descend(samples, state, _scales(samples, state), tolerance)
    return state, _loss(samples, state, _scales(samples, state))


def residual_norms(samples: Samples, state: MarkerState) -> list[FloatArray]:
    """Lengths `(n,)` of the residuals: positions (m), then rotations (rad), those that are present.

    A rotation's is the chord 2 sin(angle / 2), which is smooth up to half turns and near the angle when small.

    Parameters
    ----------
    samples : Samples, n samples
    state : MarkerState
    """
    norms = []
    if samples.p is not None and samples.u is not None:
        norms.append(np.linalg.norm(_tips(samples.p, samples.R_obs, state) - samples.u, axis=1))
    if samples.R_cmd is not None:
        chord = state.R @ samples.R_obs @ state.R_right - samples.R_cmd
        norms.append(np.linalg.norm(chord.reshape(-1, 9), axis=1) / np.sqrt(2.0))
    return norms


def _descend(samples: Samples, state: MarkerState, scales: list[float], tolerance: float) -> MarkerState:
    loss = _loss(samples, state, scales)
    for _ in range(MAX_STEPS):
        step = _gauss_newton_step(samples, state, scales)
        trial = state.moved(step)
        trial_loss = _loss(samples, trial, scales)
        for _ in range(MAX_HALVINGS):
            if trial_loss <= loss:
                break
            step = step / 2.0
            trial = state.moved(step)
            trial_loss = _loss(samples, trial, scales)
        if trial_loss > loss:
            return state
        state, loss = trial, trial_loss
        if np.linalg.norm(step) < tolerance:
            break
    return state


def _gauss_newton_step(samples: Samples, state: MarkerState, scales: list[float]) -> FloatArray:
    normal, gradient = np.zeros((12, 12)), np.zeros(12)
    parts = zip(_linearised(samples, state), residual_norms(samples, state), scales, strict=True)
    for (residual, J), norms, scale in parts:
        w = cauchy_weights(norms, scale) / scale**2
        Jw = (J * w[:, None, None]).reshape(-1, 12)
        normal += Jw.T @ J.reshape(-1, 12)
        gradient += Jw.T @ residual.ravel()
    return _solve_scaled(normal, -gradient)


def _solve_scaled(normal: FloatArray, right: FloatArray) -> FloatArray:
    """Least-norm solution with unknowns brought to one unit; those without influence do not move."""
    size = np.sqrt(np.diag(normal))
    free = size > 0.0
    scaled = normal[np.ix_(free, free)] / np.outer(size[free], size[free])
    step = np.zeros(len(right))
    step[free] = np.linalg.pinv(scaled, rcond=CONDITION, hermitian=True) @ (right[free] / size[free]) / size[free]
    return step


def _tips(p: FloatArray, R_obs: FloatArray, state: MarkerState) -> FloatArray:
    return (p + R_obs @ state.offset) @ state.R.T + state.t


def _linearised(samples: Samples, state: MarkerState) -> list[tuple[FloatArray, FloatArray]]:
    """Residuals `(n, 3)` and their derivatives `(n, 3, 12)` by the step of :meth:`MarkerState.moved`.

    Of a rotation these are three numbers that have the chord's gradient and Gauss-Newton matrix. With P the prediction,
    the chord `(P - R_cmd) / sqrt(2)` has nine; by a turn on the left its derivative is `[e_k] P / sqrt(2)`, by one on
    the right `P [e_k] / sqrt(2)`. Their products are those of the identity and P, and their products with the chord
    those of the identity and P with the vector of the skew part of `P R_cmd^T`.
    """
    parts, n = [], len(samples.R_obs)
    if samples.p is not None and samples.u is not None:
        tips, J = _tips(samples.p, samples.R_obs, state), np.zeros((n, 3, 12))
        J[..., :3] = np.einsum("kab,nb->nak", GENERATORS, tips - state.t)
        J[..., 3:6] = np.eye(3)
        J[..., 9:] = state.R @ samples.R_obs
        parts.append((tips - samples.u, J))
    if samples.R_cmd is not None:
        predicted, J = state.R @ samples.R_obs @ state.R_right, np.zeros((n, 3, 12))
        J[..., :3] = np.eye(3)
        J[..., 6:9] = predicted
        parts.append((np.einsum("kab,nab->nk", GENERATORS, predicted @ np.swapaxes(samples.R_cmd, -1, -2)) / 2.0, J))
    return parts


def _scales(samples: Samples, state: MarkerState) -> list[float]:
    scales = [component_scale(norms) for norms in residual_norms(samples, state)]
    least = [LEAST_SCALE] * len(scales)
    if samples.u is not None:
        least[0] = LEAST_SCALE * float(np.abs(samples.u).max())
    return [max(scale, floor) for scale, floor in zip(scales, least, strict=True)]


def _loss(samples: Samples, state: MarkerState, scales: list[float]) -> float:
    norms = residual_norms(samples, state)
    return sum(cauchy_loss(r, scale) for r, scale in zip(norms, scales, strict=True))
