"""The motor side of a log that speaks of poses only: joint paths by inverse kinematics of the nominal arm."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc

from gpcorrect import se3
from gpcorrect.arms import Chain
from gpcorrect.errors import DataError
from gpcorrect.sim.body import Body
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal

LENGTH = 0.1  # m that weigh as much as one radian: the reach of a surgical tool beyond its pivot
STARTS = 48  # points of a Halton sequence over the limits, from which the first poses are sought
SEEK, WALK, POLISH = 40, 20, 40  # Newton steps from far, from the pose before, and from between two solved poses
STRIDE = 10  # samples from one solved pose to the next; those between start from between them
STEP = 0.3  # rad, and LENGTH times that in m: longest Newton step
DAMPING = 1e-9  # of the squared Jacobian: only keeps singular poses finite
REACHED = 2e-5  # rad, and LENGTH times that in m: a pose written down to a micrometre is nearer
SOLVED = 1e-11  # rad, and LENGTH times that in m: no further step is made
FEW = 0.01  # fraction of the poses that may be out of reach: faults of the recording


def with_joint_paths(log: CalibrationLog, body: Body) -> tuple[CalibrationLog, tuple[str, ...]]:
    """Return a log with the joint paths that its poses stand for, where it has none, and what was done.

    `measured_jp` comes from `measured_cp`, `setpoint_jp` from `setpoint_cp`: both are the robot's own kinematics of
    its joints, so that the nominal inverse gives back just these joints. Rows without a motor position are left out.

    Parameters
    ----------
    log : CalibrationLog, recording; one with `measured_jp` or `setpoint_jp`, or of bare joints, keeps its own
    body : Body, nominal arm

    Raises
    ------
    DataError
        The nominal arm does not reach the poses.
    """
    remarks = []
    if body.chain is not None and log.measured_jp is None and log.setpoint_jp is None:
        for side in ("measured", "setpoint"):
            signal: PoseSignal | None = getattr(log, f"{side}_cp")
            if signal is not None:
                path, how = joint_path_of_poses(body, signal, log.trajectory, f"{side}_cp")
                log = replace(log, measured_jp=path) if side == "measured" else replace(log, setpoint_jp=path)
                remarks.append(f"{side}_jp computed from {side}_cp by inverse kinematics of the nominal arm{how}")
    whole = np.ones(len(log), dtype=np.bool_)
    for values in (v for v in (log.measured_jp, log.setpoint_jp) if v is not None):
        whole &= np.isfinite(values).all(axis=1)
    if not whole.all() and whole.any():
        remarks.append(f"{int((~whole).sum())} of {len(log)} rows have no motor position and are left out")
        log = log.select(whole)
    return log, tuple(remarks)


def joint_path_of_poses(
    body: Body, signal: PoseSignal, trajectory: IntArray, name: str = "poses"
) -> tuple[FloatArray, str]:
    """Return the moving joints `(n, k)` that reach poses, NaN where none do, and words on what was used.

    The first poses of all trajectories are sought from many starts; from there each path is followed. Of two branches,
    the one nearer to the middle of the joints' limits is taken for the first trajectory, and the nearest to that for
    the others.

    Parameters
    ----------
    body : Body, arm with kinematics; its other joints are held
    signal : PoseSignal, base frame; rows with NaN stay without an answer
    trajectory : (n,) int array, of each row; paths are followed inside them
    name : str, of the signal, for messages

    Raises
    ------
    DataError
        More than a few of the poses are out of reach.
    """
    rows = np.flatnonzero(signal.finite)
    if not rows.size:
        raise DataError(f"{name} holds no whole pose.", hint="Was the signal recorded? Its columns have no numbers.")
    position = signal.position[rows]
    goals = []
    if signal.quaternion is not None:
        goals.append(_Goal(body, se3.from_parts(position, signal.quaternion[rows]), turned=True))
    if len(body.joints) <= 3:
        upright = np.broadcast_to(np.eye(3), (len(rows), 3, 3))
        goals.append(_Goal(body, se3.pose(upright, position), turned=False))
    if not goals:
        raise DataError(
            f"{name} has no orientation: positions alone do not tell {len(body.joints)} joints.",
            hint="Log measured_jp or setpoint_jp, or quaternions with the positions.",
        )
    missed = []
    for goal in goals:
        q = _followed(goal, trajectory[rows])
        miss = np.maximum(_missed_by(goal, q), _beyond_limits(goal, q))
        good = miss < REACHED
        if good.mean() >= 1.0 - FEW:
            path = np.full((len(signal), len(body.joints)), np.nan)
            path[rows[good]] = q[good]
            alone = not goal.turned and signal.quaternion is not None
            return path, " (positions only: the orientations do not fit the held joints)" if alone else ""
        missed.append(float(np.median(miss[~good])))
    raise DataError(
        f"the nominal arm misses the poses of {name}, or its joint limits, by {1e3 * LENGTH * min(missed):.3g} mm or "
        f"{np.rad2deg(min(missed)):.3g} deg: they are of another arm or frame, or other joints move than the model's.",
        hint="Check arm, joints, wrist and theta_offset_deg of the model; poses must be in the base frame.",
    )


@dataclass(frozen=True, eq=False)
class _Goal:
    """Poses that an arm is to reach with k moving joints."""

    body: Body
    T: FloatArray  # (m, 4, 4)
    turned: bool  # whether their orientations count

    def __getitem__(self, rows: IntArray) -> _Goal:
        return replace(self, T=self.T[rows])

    @property
    def chain(self) -> Chain:
        assert self.body.chain is not None
        return self.body.chain

    @property
    def limits(self) -> FloatArray:
        """(k, 2), rad or m."""
        return self.chain.limits[self.body.columns]

    @property
    def turning(self) -> BoolArray:
        return np.array([kind == "R" for kind in self.body.types])

    @property
    def unit(self) -> FloatArray:
        """(k,) what counts as one radian."""
        return np.where(self.turning, 1.0, LENGTH)


def _followed(goal: _Goal, trajectory: IntArray) -> FloatArray:
    """Joints `(m, k)` along the poses."""
    groups = [np.flatnonzero(trajectory == k) for k in np.unique(trajectory)]
    stops = [np.unique(np.r_[np.arange(0, len(g), STRIDE), len(g) - 1]) for g in groups]
    here = _firsts(goal[np.array([g[0] for g in groups])])
    longest = max(len(s) for s in stops)
    solved = np.empty((longest, *here.shape))
    for i in range(longest):
        now = np.array([g[s[min(i, len(s) - 1)]] for g, s in zip(groups, stops, strict=True)])
        here = solved[i] = _newton(goal[now], here, WALK)
    start = np.empty((len(trajectory), here.shape[1]))
    for k, (g, s) in enumerate(zip(groups, stops, strict=True)):
        for j, column in enumerate(solved[: len(s), k].T):
            start[g, j] = np.interp(np.arange(len(g)), s, column)
    return _newton(goal, start, POLISH)


def _firsts(goal: _Goal) -> FloatArray:
    """Joints `(m, k)` at poses apart, all on one branch; the nearest there is where none is reached."""
    low, high = goal.limits.T
    middle, span = (low + high) / 2, high - low
    spread = qmc.Halton(len(low), scramble=False).random(STARTS + 1)[1:]
    starts = np.concatenate([middle[None], low + span * spread])
    near, chosen = middle, []
    for k in range(len(goal.T)):
        tried = np.concatenate([near[None], starts]) if k else starts
        same = goal[np.full(len(tried), k)]
        found = _newton(same, tried, SEEK)
        turns = np.round((middle - found) / (2 * np.pi))  # nearest to the middle of the limits
        found += np.where(goal.turning, 2 * np.pi * turns, 0.0)
        inside = ((found >= low) & (found <= high)).all(axis=1)
        far = (((found - near) / span) ** 2).sum(axis=1)
        near = found[np.lexsort((far, ~inside, np.maximum(_missed_by(same, found), REACHED)))[0]]
        chosen.append(near)
    return np.array(chosen)


def _beyond_limits(goal: _Goal, q: FloatArray) -> FloatArray:
    """How far `(m,)` joints are beyond their limits, rad or m over LENGTH, half a range to spare on either side."""
    low, high = goal.limits.T
    spare = 0.5 * (high - low)
    return np.asarray(np.maximum(np.maximum(low - spare - q, q - high - spare) / goal.unit, 0.0).max(axis=1))


def _newton(goal: _Goal, q: FloatArray, steps: int) -> FloatArray:
    """Damped Gauss-Newton steps `(m, k)` towards the poses, all at once."""
    unit, q, left = goal.unit, np.array(q), np.arange(len(q))
    for _ in range(steps):
        error = _error(goal[left], q[left])
        far = np.abs(error).max(axis=1) > SOLVED
        left, error = left[far], error[far]
        if len(left) == 0:
            break
        J = goal.chain.jacobian(goal.body.all_joints(q[left]))[..., goal.body.columns] * unit
        J = np.concatenate([J[:, :3] / LENGTH, J[:, 3:]], axis=1)[:, : error.shape[1]]
        square = np.swapaxes(J, 1, 2) @ J + DAMPING * np.eye(len(unit))
        move = np.linalg.solve(square, np.swapaxes(J, 1, 2) @ error[..., None])[..., 0]
        q[left] += unit * move * np.minimum(1.0, STEP / np.maximum(np.abs(move).max(axis=1, keepdims=True), 1e-300))
    return q


def _error(goal: _Goal, q: FloatArray) -> FloatArray:
    """Wanted less reached: `(m, 6)` positions over LENGTH and rotation vectors, or positions `(m, 3)`."""
    T = goal.chain.forward(goal.body.all_joints(q))
    position = (goal.T[:, :3, 3] - T[:, :3, 3]) / LENGTH
    if not goal.turned:
        return position
    turn = se3.rotvec_from_matrix(goal.T[:, :3, :3] @ np.swapaxes(T[:, :3, :3], 1, 2))
    return np.concatenate([position, turn], axis=1)


def _missed_by(goal: _Goal, q: FloatArray) -> FloatArray:
    """How far `(m,)` the poses are missed, rad or m over LENGTH."""
    return np.asarray(np.abs(_error(goal, q)).max(axis=1))
