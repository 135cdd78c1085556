"""The marker is not the tool tip: tracker registration and marker offset from the same data (A X = Y B).

Also position and orientation that belong to different points of the tool, each registered for itself. The two
rotations, the translation and the lever arm are refined together by robust Gauss-Newton.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product
from typing import NamedTuple

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.rigid.model import RigidModel
from gpcorrect.rigid.observability import Observability, rotation_observability
from gpcorrect.rigid.registration import (
    WIDTH,
    cauchy_weights,
    check_pair,
    component_scale,
    evenly_spaced,
    fit_robustly,
)
from gpcorrect.types import FloatArray, PoseSignal

START_ROUNDS = 3  # of weights before Gauss-Newton, which has its own: enough to leave gross errors behind
ITERATIONS = 30  # a start: the alternation creeps where rotations are small, and Gauss-Newton finishes it
MEAN_ROUNDS = 20  # of weighing rotations: converged to rounding well before

# The 24 rotations of a cube: no rotation is further than 63 degrees from one of them.
SIGNED = [np.eye(3)[list(p)] * s for p in permutations(range(3)) for s in product((1.0, -1.0), repeat=3)]
CUBE = np.array([m for m in SIGNED if np.linalg.det(m) > 0.0])

GENERATORS = se3.hat(np.eye(3))  # GENERATORS[k] @ v = e_k x v
SCALE_ROUNDS, KNOWN_ROUNDS = 5, 2  # of robust scales, and from a start that has them nearly right; chosen by hand
MAX_STEPS = 60  # Gauss-Newton ends by its tolerance before
MAX_HALVINGS = 12  # a step 4000 times shorter that does not help is no descent
STEP_TOLERANCE = 1e-11  # rad and m: below what any sensor sees
COARSE_TOLERANCE = 1e-6  # the same while the scales still change, or kinds are compared: below any noise
LEAST_SCALE = 1e-6  # of the spread of the points, and rad: keeps exact positions from silencing rotations
CONDITION = 1e-14  # of the normal equations: weaker directions are not determined and stay as they are


def fit_marker(observed: PoseSignal, command: PoseSignal, near: RigidModel | None = None) -> RigidModel:
    """Solve `T_base_tracker X_i T_marker_tip = U_i` for the registration of the tracker and the tip's pose.

    The problem is the AX = YB of Zhuang, Roth and Sudhakar (IEEE T-RA 10(4), 1994). Both rotations start from the
    alternation of :func:`two_sided_rotations`, translation and lever arm from linear least squares; all twelve
    unknowns are then refined together by Gauss-Newton under a Cauchy loss, positions and rotations each on their own
    robust scale. Where the commands have no orientations, the lever arm follows from the positions alone and the
    orientation of the tip in the marker stays the identity.

    Parameters
    ----------
    observed : PoseSignal, poses X_i of the marker in the tracker's frame, with orientations; n samples, all finite
    command : PoseSignal, poses U_i (or positions) of the tip in the base frame
    near : RigidModel, optional
        Solution of nearly the same samples: the refinement starts from it alone, and ends where a step moves
        less than any noise: to be compared, not to be kept.

    Raises
    ------
    DataError
        No observed orientations, signals of unequal length, missing samples.
    DegenerateError
        Fewer than three samples, or too little rotation: which part is not observable, with numbers.
    """
    require_observable(observed, command)
    rows = evenly_spaced(len(observed))
    observed, command = observed[rows], command[rows]
    assert observed.quaternion is not None
    centre_p, centre_u = observed.position.mean(axis=0), command.position.mean(axis=0)
    samples = _Samples(
        se3.matrix_from_quaternion(observed.quaternion),
        p=observed.position - centre_p,
        u=command.position - centre_u,
        R_cmd=None if command.quaternion is None else se3.matrix_from_quaternion(command.quaternion),
    )
    if near is not None:
        starts = [_State(near.R_position, near.t - centre_u + near.R_position @ centre_p, near.R_right, near.offset)]
    elif samples.R_cmd is not None:
        starts = [_with_lever_arm(samples, *_start_rotations(samples.R_obs, samples.R_cmd))]
    else:  # without a lever arm, and from a linear solution
        rotations = (fit_robustly(observed, command).R_position, _rotation_from_positions(samples))
        starts = [_with_lever_arm(samples, R, np.eye(3)) for R in rotations]
    state = min((_refine(samples, start, known=near is not None) for start in starts), key=lambda end: end[1])[0]
    t = state.t + centre_u - state.R @ centre_p
    return RigidModel("marker", R_position=state.R, t=t, offset=state.offset, R_left=state.R, R_right=state.R_right)


def require_observable(observed: PoseSignal, command: PoseSignal) -> Observability:
    """Observability of the marker's place on the tool, when it is observable.

    Parameters
    ----------
    observed : PoseSignal, poses of the marker in the tracker frame
    command : PoseSignal, poses of the tip in the base frame
    """
    check_pair(observed, command)
    observability = rotation_observability(observed, command)
    if observability is None:
        raise DataError(
            "a marker offset is solved from observed orientations, but positions alone were observed.",
            hint='Register with marker="none".',
        )
    observability.require()
    return observability


def fit_separate(observed: PoseSignal, command: PoseSignal, near: RigidModel | None = None) -> RigidModel:
    """Points registered by points, orientations by `R_left R_obs R_right = R_cmd`, both robustly.

    Trackers that solve wrist and tip from different fiducials report such poses: no one rigid body explains both.
    Rotation about two axes determines R_left and R_right; rotation about one leaves a turn about it open, and the
    smallest R_right is taken; without rotation only the product is known, and R_right is the identity.

    Parameters
    ----------
    observed, command : PoseSignal, n samples each with orientations, all finite
    near : RigidModel, optional
        Solution of nearly the same samples: the refinement of orientations starts from it, and ends as for
        :func:`fit_marker`.

    Raises
    ------
    DataError
        Orientations missing, signals of unequal length, missing samples.
    DegenerateError
        Fewer than three samples, or points that coincide or lie on one line.
    """
    check_pair(observed, command)
    points = fit_robustly(observed, command, near)
    R_left, R_right = _fit_orientations(observed, command, near)
    return RigidModel("separate", R_position=points.R_position, t=points.t, R_left=R_left, R_right=R_right)


def _start_rotations(R_obs: FloatArray, R_cmd: FloatArray) -> tuple[FloatArray, FloatArray]:
    weights = np.ones(len(R_obs))
    for _ in range(START_ROUNDS):
        R_left, R_right = two_sided_rotations(R_obs, R_cmd, weights)
        state = _State(R_left, np.zeros(3), R_right, np.zeros(3))
        weights = _weights(*_residual_norms(_Samples(R_obs, R_cmd=R_cmd), state))
    return R_left, R_right


def _with_lever_arm(samples: _Samples, R: FloatArray, R_right: FloatArray) -> _State:
    """Solve `R_obs offset + R^T t = R^T u - p`, linear in translation and lever arm for known rotations."""
    assert samples.p is not None
    assert samples.u is not None
    A = np.concatenate([samples.R_obs, np.broadcast_to(np.eye(3), samples.R_obs.shape)], axis=-1)
    solution = _reweighted(A, samples.u @ R - samples.p)
    return _State(R, R @ solution[3:], R_right, solution[:3])


def _rotation_from_positions(samples: _Samples) -> FloatArray:
    """Solve `R^T u - R_obs offset - R^T t = p`, linear in the entries of R^T, the offset and R^T t."""
    assert samples.p is not None
    assert samples.u is not None
    A = np.zeros((len(samples.p), 3, 15))
    for row in range(3):
        A[:, row, 3 * row : 3 * row + 3] = samples.u
    A[..., 9:12] = -samples.R_obs
    A[..., 12:] = -np.eye(3)
    return se3.nearest_rotation(_reweighted(A, samples.p)[:9].reshape(3, 3)).T


def _reweighted(A: FloatArray, b: FloatArray) -> FloatArray:
    """Robust solution `(k,)` of `A x = b` for `(n, 3, k)` and `(n, 3)`."""
    w = np.ones(len(b))
    for _ in range(START_ROUNDS):
        root = np.sqrt(w)[:, None]
        rows = (A * root[..., None]).reshape(-1, A.shape[-1])
        x: FloatArray = np.linalg.lstsq(rows, (b * root).ravel())[0].astype(np.float64)
        w = _weights(np.linalg.norm(A @ x - b, axis=1))
    return x


def _weights(norms: FloatArray) -> FloatArray:
    return cauchy_weights(norms, component_scale(norms))


def _fit_orientations(
    observed: PoseSignal, command: PoseSignal, near: RigidModel | None
) -> tuple[FloatArray, FloatArray]:
    observability = rotation_observability(observed, command)
    if observability is None or observed.quaternion is None or command.quaternion is None:
        raise DataError("separate registration needs observed and commanded orientations, got positions only.")
    rows = evenly_spaced(len(observed))
    R_obs = se3.matrix_from_quaternion(observed.quaternion[rows])
    R_cmd = se3.matrix_from_quaternion(command.quaternion[rows])
    if observability.n_axes == 0:
        return _robust_left(R_obs, R_cmd, np.eye(3)), np.eye(3)
    R_left, R_right = _start_rotations(R_obs, R_cmd) if near is None else (near.R_left, near.R_right)
    start = _State(R_left, np.zeros(3), R_right, np.zeros(3))
    R_left, _, R_right, _ = _refine(_Samples(R_obs, R_cmd=R_cmd), start, known=near is not None)[0]
    if observability.n_axes == 1:  # of the rotations `exp(phi axis) R_right` that of smallest angle, of largest trace
        axis = observability.axes[0]
        sine, cosine = np.trace(se3.hat(axis) @ R_right), np.trace(R_right) - axis @ R_right @ axis
        R_right = se3.matrix_from_rotvec(np.arctan2(sine, cosine) * axis) @ R_right
        R_left = _robust_left(R_obs, R_cmd, R_right)
    return R_left, R_right


def _robust_left(R_obs: FloatArray, R_cmd: FloatArray, R_right: FloatArray) -> FloatArray:
    """Return the rotation R_left of least `sum w ||R_left R_obs R_right - R_cmd||_F^2` over `(n, 3, 3)` stacks."""
    w = np.ones(len(R_obs))
    for _ in range(MEAN_ROUNDS):
        R_left = se3.nearest_rotation(np.einsum("n,nab,ncb->ac", w, R_cmd, R_obs @ R_right))
        away = se3.angle(R_left @ R_obs @ R_right @ np.swapaxes(R_cmd, -1, -2))
        w = cauchy_weights(away, component_scale(away))
    return R_left


def two_sided_rotations(R_obs: FloatArray, R_cmd: FloatArray, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations (R_left, R_right) of least `sum w ||R_left R_obs R_right - R_cmd||_F^2`.

    For a given R_right the best R_left is one SVD, and the other way round; both need the data only as the sum of the
    products of their entries. The two alternate from the 24 rotations of a cube; the best end wins.

    Parameters
    ----------
    R_obs, R_cmd : (n, 3, 3) arrays, rotations that belong together
    w : (n,) array, non-negative weights
    """
    n = len(w)
    moments = ((R_cmd.reshape(n, 9) * w[:, None]).T @ R_obs.reshape(n, 9)).reshape(3, 3, 3, 3)
    R_right = CUBE
    for _ in range(ITERATIONS):
        R_left = se3.nearest_rotation(np.einsum("abcd,sdb->sac", moments, R_right))
        R_right = se3.nearest_rotation(np.einsum("abcd,sac->sdb", moments, R_left))
    agreement = np.einsum("abcd,sac,sdb->s", moments, R_left, R_right)
    best = int(np.argmax(agreement))
    return R_left[best], R_right[best]


class _State(NamedTuple):
    """The unknowns of `u = R (p + R_obs offset) + t` and `R_cmd = R R_obs R_right`."""

    R: FloatArray
    t: FloatArray
    R_right: FloatArray
    offset: FloatArray

    def moved(self, step: FloatArray) -> _State:
        """State after a step `(12,)`: of R from the left (rad), t (m), R_right from the right, offset."""
        return _State(
            se3.matrix_from_rotvec(step[:3]) @ self.R,
            self.t + step[3:6],
            self.R_right @ se3.matrix_from_rotvec(step[6:9]),
            self.offset + step[9:],
        )


@dataclass(frozen=True, eq=False)
class _Samples:
    """What is to be explained; an absent part (None) puts no demand on the unknowns."""

    R_obs: FloatArray  # (n, 3, 3) observed rotations
    # (n, 3) observed and commanded positions, each about its own centre, m
    p: FloatArray | None = None
    u: FloatArray | None = None
    R_cmd: FloatArray | None = None  # (n, 3, 3) commanded rotations


def _refine(samples: _Samples, start: _State, *, known: bool) -> tuple[_State, float]:
    """State of least Cauchy loss near `start`, and the loss.

    Positions and rotations are each measured in units of their own robust scale, which follows the fit. Where the start
    is `known` to solve nearly the same samples, and the end is only to be compared, few rounds and steps below any
    noise end it.
    """
    state, rounds = start, KNOWN_ROUNDS if known else SCALE_ROUNDS
    for tolerance in (*[COARSE_TOLERANCE] * (rounds - 1), COARSE_TOLERANCE if known else STEP_TOLERANCE):
        state = _descend(samples, state, _scales(samples, state), tolerance)
    return state, _loss(samples, state, _scales(samples, state))


def _residual_norms(samples: _Samples, state: _State) -> list[FloatArray]:
    """Lengths `(n,)` of the residuals: positions (m), then rotations (rad), those that are present.

    A rotation's is the chord 2 sin(angle / 2), which is smooth up to half turns and near the angle when small.
    """
    norms = []
    if samples.p is not None and samples.u is not None:
        norms.append(np.linalg.norm(_tips(samples.p, samples.R_obs, state) - samples.u, axis=1))
    if samples.R_cmd is not None:
        chord = state.R @ samples.R_obs @ state.R_right - samples.R_cmd
        norms.append(np.linalg.norm(chord.reshape(-1, 9), axis=1) / np.sqrt(2.0))
    return norms


def _descend(samples: _Samples, state: _State, scales: list[float], tolerance: float) -> _State:
    loss = _loss(samples, state, scales)
    for _ in range(MAX_STEPS):
        step = _gauss_newton_step(samples, state, scales)
        for _ in range(1 + MAX_HALVINGS):
            trial = state.moved(step)
            trial_loss = _loss(samples, trial, scales)
            if trial_loss <= loss:
                break
            step = step / 2.0
        else:
            return state
        state, loss = trial, trial_loss
        if np.linalg.norm(step) < tolerance:
            break
    return state


def _gauss_newton_step(samples: _Samples, state: _State, scales: list[float]) -> FloatArray:
    normal, gradient = np.zeros((12, 12)), np.zeros(12)
    parts = zip(_linearised(samples, state), _residual_norms(samples, state), scales, strict=True)
    for (residual, J), norms, scale in parts:
        w = cauchy_weights(norms, scale) / scale**2
        Jw = (J * w[:, None, None]).reshape(-1, 12)
        normal += Jw.T @ J.reshape(-1, 12)
        gradient += Jw.T @ residual.ravel()
    # The least-norm solution with unknowns brought to one unit; those without influence do not move.
    size = np.sqrt(np.diag(normal))
    free = size > 0.0
    scaled = normal[np.ix_(free, free)] / np.outer(size[free], size[free])
    step = np.zeros(12)
    step[free] = np.linalg.pinv(scaled, rcond=CONDITION, hermitian=True) @ (-gradient[free] / size[free]) / size[free]
    return step


def _tips(p: FloatArray, R_obs: FloatArray, state: _State) -> FloatArray:
    return (p + R_obs @ state.offset) @ state.R.T + state.t


def _linearised(samples: _Samples, state: _State) -> list[tuple[FloatArray, FloatArray]]:
    """Residuals `(n, 3)` and their derivatives `(n, 3, 12)` by the step of :meth:`_State.moved`.

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


def _scales(samples: _Samples, state: _State) -> list[float]:
    scales = [component_scale(norms) for norms in _residual_norms(samples, state)]
    least = [LEAST_SCALE] * len(scales)
    if samples.u is not None:
        least[0] = LEAST_SCALE * float(np.abs(samples.u).max())
    return [max(scale, floor) for scale, floor in zip(scales, least, strict=True)]


def _loss(samples: _Samples, state: _State, scales: list[float]) -> float:
    """Sum of the loss whose weights :func:`cauchy_weights` gives: `WIDTH^2 log(1 + (r / (WIDTH scale))^2)`."""
    parts = zip(_residual_norms(samples, state), scales, strict=True)
    return sum(float(WIDTH**2 * np.log1p((norms / (WIDTH * scale)) ** 2).sum()) for norms, scale in parts)
