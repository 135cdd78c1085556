"""The marker is not the tool tip: tracker registration and marker offset from the same data (A X = Y B).

Also position and orientation that belong to different points of the tool, each registered for itself.
"""

from __future__ import annotations

from itertools import permutations, product

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.rigid.model import RigidModel
from gpcorrect.rigid.observability import Observability, rotation_observability
from gpcorrect.rigid.refine import MarkerState, Samples, refine, residual_norms
from gpcorrect.rigid.registration import cauchy_weights, check_pair, component_scale, evenly_spaced, fit_robustly
from gpcorrect.types import FloatArray, PoseSignal

START_ROUNDS = 3  # of weights before Gauss-Newton, which has its own: enough to leave gross errors behind
ITERATIONS = 30  # a start: the alternation creeps where rotations are small, and Gauss-Newton finishes it
MEAN_ROUNDS = 20  # of weighing rotations: converged to rounding well before


def fit_marker(observed: PoseSignal, command: PoseSignal, near: RigidModel | None = None) -> RigidModel:
    """Solve `T_base_tracker X_i T_marker_tip = U_i` for the registration of the tracker and the tip's pose.

    The problem is the AX = YB of Zhuang, Roth and Sudhakar (IEEE T-RA 10(4), 1994). Both rotations start from the
    alternation of :func:`two_sided_rotations`, translation and lever arm from linear least squares; all twelve
    unknowns are then refined together by Gauss-Newton under a Cauchy loss, positions and rotations each on their own
    robust scale. Where the commands have no orientations, the lever arm follows from the positions alone and the
    orientation of the tip in the marker stays the identity.

    Parameters
    ----------
    observed : PoseSignal
        Poses X_i of the marker in the tracker's frame, with orientations; n samples, all finite.
    command : PoseSignal
        Poses U_i (or positions) of the tip in the base frame.
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
    samples = Samples(
        se3.matrix_from_quaternion(observed.quaternion),
        p=observed.position - centre_p,
        u=command.position - centre_u,
        R_cmd=None if command.quaternion is None else se3.matrix_from_quaternion(command.quaternion),
    )
    if near is not None:
        starts = [
            MarkerState(near.R_position, near.t - centre_u + near.R_position @ centre_p, near.R_right, near.offset)
        ]
    elif samples.R_cmd is not None:
        starts = [_with_lever_arm(samples, *_start_rotations(samples.R_obs, samples.R_cmd))]
    else:  # without a lever arm, and from a linear solution
        rotations = (fit_robustly(observed, command).R_position, _rotation_from_positions(samples))
        starts = [_with_lever_arm(samples, R, np.eye(3)) for R in rotations]
    state = min((refine(samples, start, known=near is not None) for start in starts), key=lambda end: end[1])[0]
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
    observed, command : PoseSignal
        n samples each with orientations, all finite.
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
        state = MarkerState(R_left, np.zeros(3), R_right, np.zeros(3))
        weights = _weights(*residual_norms(Samples(R_obs, R_cmd=R_cmd), state))
    return R_left, R_right


def _with_lever_arm(samples: Samples, R: FloatArray, R_right: FloatArray) -> MarkerState:
    """Solve `R_obs offset + R^T t = R^T u - p`, linear in translation and lever arm for known rotations."""
    assert samples.p is not None
    assert samples.u is not None
    A = np.concatenate([samples.R_obs, np.broadcast_to(np.eye(3), samples.R_obs.shape)], axis=-1)
    solution = _reweighted(A, samples.u @ R - samples.p)
    return MarkerState(R, R @ solution[3:], R_right, solution[:3])


def _rotation_from_positions(samples: Samples) -> FloatArray:
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
    start = MarkerState(R_left, np.zeros(3), R_right, np.zeros(3))
    R_left, _, R_right, _ = refine(Samples(R_obs, R_cmd=R_cmd), start, known=near is not None)[0]
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


# The 24 rotations of a cube: no rotation is further than 63 degrees from one of them.
SIGNED = [np.eye(3)[list(p)] * s for p in permutations(range(3)) for s in product((1.0, -1.0), repeat=3)]
CUBE = np.array([m for m in SIGNED if np.linalg.det(m) > 0.0])


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
