"""The tracker beside the simulator: poses of its marker, and what of their residual nobody asks for.

A tracker with thousands of samples sees table errors of a hundredth of its noise, and some effect of the catalogue can
always be bent to fit them. Errors of the arm's table and of the registration within the tolerance of any good
calibration are therefore part of what the nominal arm may be: the residual is multiplied by the square root of the
covariance that noise and tolerance have together, which leaves nothing of errors within the tolerance but noise, and of
larger ones what is beyond it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from gpcorrect import se3
from gpcorrect.arms import Chain
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.settings import NOISE
from gpcorrect.errors import DataError
from gpcorrect.sim.body import Body
from gpcorrect.types import BoolArray, FloatArray, IntArray

STEP = 1e-5  # rad or m, for slopes
MOUNT_STEPS, MOUNT_FOUND = 8, 1e-8  # of a fit; m, of its last step
PLACED_BY = 3  # rows, of which a place can be told
ENOUGH = 2000  # rows to tell by: a mixed-up joint is no matter of noise
Misfit = Callable[[FloatArray, IntArray], float]  # by the signs and the order of joints
ROW_TERMS = {"alpha": NOISE.table_angle, "a": NOISE.table_length, "d": NOISE.table_length, "theta": NOISE.table_angle}


@dataclass(frozen=True, eq=False)
class Tracker:
    """What a tracker measured at n rows, and what the model leaves open of its frames."""

    position: FloatArray  # (n, 3) m; NaN is missing
    rows: BoolArray  # (n,) on which an open frame is registered
    base_known: bool  # in the tracker's frame
    marker_known: bool  # on the tip
    mount: FloatArray | None = None  # (3,) m, where the marker is fitted from; None is where the model has it
    rotation: FloatArray | None = None  # (n, 3, 3) measured orientations; None where only positions are compared
    reference: FloatArray | None = None  # the nominal model's: turns are written down about them, and so stay small
    session: IntArray | None = None  # (n,) where it was put up anew in each session; None where it stood still

    def with_places(self, session: IntArray, T: FloatArray) -> tuple[Tracker, str]:
        """Return the tracker with a place of its own in each session, and in words, where that explains the log.

        A tripod that was moved between two sessions is no fault of the arm. Homing offsets move a session's poses too,
        but less far.

        Parameters
        ----------
        session : (n,) int array
        T : (n, 4, 4) array, marker poses of the nominal model
        """
        moved = replace(self, session=session)
        seen = self.rows & np.isfinite(self.position).all(axis=1)
        if self.base_known or len(moved._places) == 1 or min(np.sum(seen & its) for its in moved._places) < PLACED_BY:
            return self, ""
        one, each = (t._position(T)[0][seen] for t in (self, moved))
        before, left = (float(np.nanmean((self.position[seen] - position) ** 2)) for position in (one, each))
        apart = float(np.sqrt(np.nanmean(np.sum((each - one) ** 2, axis=1))))
        if apart < NOISE.moved or left > NOISE.by_mount**2 * before:
            return self, ""
        words = f"the tracker is registered in each session anew, for one place leaves {1e3 * apart:.0f} mm more"
        return moved, f"{words}: it was moved; a homing offset that is as good as a move of the base stays open"

    def with_mount(self, T: FloatArray) -> tuple[Tracker, str]:
        """Return the tracker with a marker that is fitted away from the tip, and in words, where that explains the log.

        Nobody mounts a marker in the tip itself. Where the model is silent, a place that leaves less than half of the
        residual, farther off than a tool's table errs, is the marker's: then a tool's length cannot be told from it.

        Parameters
        ----------
        T : (n, 4, 4) array, marker poses of the nominal model
        """
        if self.marker_known:
            return self, ""
        moved = replace(self, mount=np.zeros(3))
        mount = moved._fitted_mount(T)
        if np.linalg.norm(mount) < NOISE.mounted:
            return self, ""
        left, before = (float(np.nanmean((self.position - t._position(T)[0])[self.rows] ** 2)) for t in (moved, self))
        if left > NOISE.by_mount**2 * before:
            return self, ""
        x, y, z = 1e3 * mount
        words = f"the tracker's marker is taken to sit {x:.1f}, {y:.1f}, {z:.1f} mm from the tip, along the tip's axes"
        why = "where it fits best, for the model has no T_tip_marker; the length of the tool itself stays open"
        return replace(self, mount=mount), f"{words}: {why}"

    def with_orientations(self, quaternion: FloatArray | None, T: FloatArray) -> tuple[Tracker, str]:
        """Return the tracker with orientations compared about simulated ones, and why not, where they cannot be.

        Parameters
        ----------
        quaternion : (n, 4) array or None, measured, wxyz
        T : (n, 4, 4) array, marker poses of the nominal model
        """
        if quaternion is None:
            return self, "the tracker's log holds no orientations: positions alone are compared"
        rotation = se3.matrix_from_quaternion(quaternion)
        seen = self.rows & np.isfinite(rotation[:, 0, 0])
        if not seen.any():
            return self, "the tracker's orientations are missing: positions alone are compared"
        _, reference = self._placed(T, rotation)
        angle = float(np.sqrt(np.mean(se3.angle(reference[seen].swapaxes(1, 2) @ rotation[seen]) ** 2)))
        if angle > NOISE.most_turned:
            words = f"the tracker's orientations do not follow the arm's ({np.degrees(angle):.0f} degrees RMS between)"
            return self, f"{words}: positions alone are compared"
        return replace(self, rotation=rotation, reference=reference), ""

    @cached_property
    def observed(self) -> FloatArray:
        """Measured `(n, 3)` positions, with `(n, 3)` rotation vectors behind them where orientations are compared."""
        return self.position if self.rotation is None else self._with_turns(self.position, self.rotation)

    def predicted(self, T: FloatArray) -> FloatArray:
        """Return what the tracker should say, of the same shape as what was observed.

        Parameters
        ----------
        T : (n, 4, 4) array, simulated marker poses, in the tracker's frame as far as the model knows it
        """
        if self.rotation is None:
            return self._position(T)[0]
        return self._with_turns(*self._placed(T, self.rotation))

    @cached_property
    def _places(self) -> tuple[BoolArray, ...]:
        """Rows `(n,)` of each place where the tracker stood."""
        if self.session is None:
            return (np.ones(len(self.position), dtype=np.bool_),)
        return tuple(self.session == number for number in np.unique(self.session))

    def _position(self, T: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions of the marker in the tracker's frame, and rotations `(k, 3, 3)` onto its k places."""
        if self.mount is None:
            return self._registered(T[:, :3, 3])
        return self._registered(T[:, :3, 3] + T[:, :3, :3] @ self._fitted_mount(T))

    def _registered(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions moved rigidly onto the tracker's where its frame is open (Arun 1987), and rotations of k places."""
        if self.base_known:
            return position, np.eye(3)[None].repeat(len(self._places), axis=0)
        rows = self.rows & np.isfinite(self.position).all(axis=1) & np.isfinite(position).all(axis=1)
        registered, turns = np.empty_like(position), []
        for its in self._places:
            a, b = position[rows & its], self.position[rows & its]
            middle, centre = a.mean(axis=0), b.mean(axis=0)
            turns.append(se3.nearest_rotation((b - centre).T @ (a - middle)))
            registered[its] = (position[its] - middle) @ turns[-1].T + centre
        return registered, np.stack(turns)

    def _fitted_mount(self, T: FloatArray) -> FloatArray:
        """Where on the tip `(3,)` a marker fits best, by Gauss-Newton steps beside a registration that moves along.

        In directions of which the recorded turns of the tip show too little it stays where it was.
        """
        assert self.mount is not None
        mount = self.mount
        rows = self.rows & np.isfinite(self.position).all(axis=1) & np.isfinite(T[:, :3, 3]).all(axis=1)
        for _ in range(MOUNT_STEPS if rows.any() else 0):
            position, turns = self._registered(T[:, :3, 3] + T[:, :3, :3] @ mount)
            turned = np.empty((len(T), 3, 3))
            for its, turn in zip(self._places, turns, strict=True):
                own = rows & its
                turned[own] = turn @ T[own, :3, :3]
                if not self.base_known:
                    turned[own] = _beside_base(turned[own], position[own])
            moved = turned[rows].reshape(-1, 3)
            squares, axes = np.linalg.eigh(moved.T @ moved / rows.sum())
            seen = axes[:, squares > NOISE.mount_seen**2]
            error = (self.position - position)[rows].ravel()
            step = seen @ np.linalg.solve(seen.T @ (moved.T @ moved) @ seen, seen.T @ (moved.T @ error))
            mount = mount + step
            if np.linalg.norm(step) < MOUNT_FOUND:
                break
        return mount

    def _placed(self, T: FloatArray, measured: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions and orientations in the tracker's frame, the marker turned on the tip as it fits best."""
        position, turns = self._position(T)
        rotation = np.empty((len(T), 3, 3))
        for its, turn in zip(self._places, turns, strict=True):
            # One product of large matrices each, several times as fast as one of small ones a row.
            rotation[its] = np.tensordot(T[its, :3, :3], turn, axes=(1, 1)).swapaxes(1, 2)
        if not self.marker_known:
            seen = self.rows & np.isfinite(measured[:, 0, 0])
            between = rotation[seen].reshape(-1, 3).T @ measured[seen].reshape(-1, 3)
            rotation = (rotation.reshape(-1, 3) @ se3.nearest_rotation(between)).reshape(-1, 3, 3)
        return position, rotation

    def _with_turns(self, position: FloatArray, rotation: FloatArray) -> FloatArray:
        """Positions, and rotation vectors (tracker's frame) from the reference to these orientations; NaN stays."""
        assert self.reference is not None
        turns = se3.rotvec_from_matrix(rotation @ self.reference.swapaxes(1, 2))
        return np.concatenate([position, turns], axis=1)


def _beside_base(moved: FloatArray, position: FloatArray) -> FloatArray:
    """Return what `(n, 3, 3)` a mount moves at n positions beyond what a turn and a shift of the base would do."""
    turned = np.cross(np.eye(3), (position - position.mean(axis=0))[:, None, :]).swapaxes(1, 2)
    base = np.concatenate([turned, np.broadcast_to(np.eye(3), turned.shape)], axis=2).reshape(-1, 6)
    columns = moved.reshape(-1, 3)
    left = columns - base @ (np.linalg.pinv(base.T @ base, hermitian=True) @ (base.T @ columns))
    return np.asarray(left.reshape(-1, 3, 3))


@dataclass(frozen=True, eq=False)
class Slack:
    """A linear part of the residual that is left out of account: what r errors of table and registration explain."""

    slopes: FloatArray  # (n, c, r) what a standard deviation of each changes in the channels
    pick: FloatArray  # (r, m) takes their sizes, as far as they are left out, from m residuals
    rows: BoolArray  # (n, c) of which these are

    def part(self, residual: FloatArray) -> FloatArray:
        """Return the part `(n, c)` of a residual that is left out of account.

        Parameters
        ----------
        residual : (n, c) array
        """
        return np.asarray(self.slopes @ (self.pick @ residual[self.rows]))


def slack_of(slopes: FloatArray, rows: BoolArray, noises: tuple[ChannelNoise, ...], step: float) -> Slack:
    """Return what is left of residuals once they are multiplied by (I + B B^T)^(-1/2), B the slopes over the noise.

    Parameters
    ----------
    slopes : (n, c, r) array, change of the channels for one standard deviation of each error
    rows : (n, c) bool array, measured rows that may be looked at
    noises : tuple of ChannelNoise
    step : float, seconds from sample to sample: slow noise counts for less, the denser the samples
    """
    scale = np.array([np.sqrt(n.white**2 + n.slow**2 * max(1.0, 2.0 * n.time_constant / step)) for n in noises])
    scale = np.broadcast_to(scale, rows.shape)[rows][:, None]
    U, s, Vt = np.linalg.svd(slopes[rows] / scale, full_matrices=False)
    seen = s > 1e-9 * max(s.max(initial=0.0), 1e-300)
    U, s, Vt = U[:, seen], s[seen], Vt[seen]
    shrunk = (1.0 - 1.0 / np.sqrt(1.0 + s**2)) / s
    return Slack(slopes, (Vt.T * shrunk) @ (U / scale).T, rows)


def table_slopes(chain: Chain, q: FloatArray, T_tracker_base: FloatArray, tracker: Tracker) -> FloatArray:
    """Change of what a tracker says `(n, a, r)` for a standard deviation of every table entry and of the registration.

    Parameters
    ----------
    chain : Chain, nominal arm, up to the marker
    q : (n, dof) array, all its joints
    T_tracker_base : (4, 4) array, as the model states it, or the identity
    tracker : Tracker, that sees a of its axes: what its own registration takes up is no change
    """
    arms = [
        (replace(chain, joints=(*chain.joints[:i], moved, *chain.joints[i + 1 :])), size)
        for i, joint in enumerate(chain.joints)
        for name, size in ROW_TERMS.items()
        for moved in [replace(joint, **{name: getattr(joint, name) + STEP})]
    ]
    tip = chain.forward(q)
    nominal = tracker.predicted(T_tracker_base @ tip)
    columns = [(tracker.predicted(T_tracker_base @ arm.forward(q)) - nominal) * (size / STEP) for arm, size in arms]
    if tracker.base_known:
        for k, size in enumerate([NOISE.table_length] * 3 + [NOISE.table_angle] * 3):
            moved_base = T_tracker_base @ se3.exp(STEP * np.eye(6)[k])
            columns.append((tracker.predicted(moved_base @ tip) - nominal) * (size / STEP))
    return np.stack(columns, axis=2)


def tracker_misfit(tracker: Tracker, body: Body, q: FloatArray, T_tracker_base: FloatArray) -> Misfit:
    """Return how far a tracker's positions are from an arm's, m RMS, by the signs and the order of its joints.

    Parameters
    ----------
    tracker : Tracker
    body : Body, whose chain goes up to the marker
    q : (n, k) array, its moving joints
    T_tracker_base : (4, 4) array, as the model states it, or the identity
    """
    seen = np.flatnonzero(tracker.rows & np.isfinite(tracker.position).all(axis=1))
    some = seen[:: max(1, len(seen) // ENOUGH)]
    session = None if tracker.session is None else tracker.session[some]
    tracker, q = replace(tracker, position=tracker.position[some], rows=tracker.rows[some], session=session), q[some]
    if not tracker.marker_known:
        tracker = replace(tracker, mount=np.zeros(3))  # wherever it sits in each of them

    def left(signs: FloatArray, order: IntArray) -> float:
        poses = body.forward(signs * q[:, order])
        assert poses is not None
        error = tracker.position - tracker.predicted(T_tracker_base @ poses)
        return float(np.sqrt(np.nanmean(error**2)))

    return left


def refuse_mixed_joints(body: Body, signal: str, roughly: Misfit, exactly: Misfit, residual: str) -> None:
    """Refuse joints of another sign or order than the model's, which no effect of the catalogue is.

    Turned, or exchanged, they leave a small part of the residual.

    Parameters
    ----------
    body : Body, whose joints they are
    signal : str, that the joints are taken from
    roughly, exactly : callables
        What is left, of any unit, by the signs `(k,)` and the order `(k,)` of the joints: roughly for all of them, and
        exactly where that looks better by far.
    residual : str, of what

    Raises
    ------
    DataError
        There are such joints.
    """
    k = len(body.joints)
    plain, here = np.ones(k), np.arange(k)
    ways = {f"joint {j} moves the other way": (np.where(here == i, -1.0, 1.0), here) for i, j in enumerate(body.joints)}
    for a, b in combinations(range(k), 2):
        if body.types[a] == body.types[b]:
            order = np.where(here == a, b, np.where(here == b, a, here))
            ways[f"joints {body.joints[a]} and {body.joints[b]} are exchanged"] = plain, order
    best, what = min((roughly(*way), what) for what, way in ways.items())
    if best > NOISE.perhaps_mixed * roughly(plain, here):
        return
    left = exactly(plain, here)
    if left > NOISE.rounding and exactly(*ways[what]) < NOISE.mixed_up * left:
        raise DataError(
            f"{signal}: {what}. Put right, less than {100 * NOISE.mixed_up:.0f} % of {residual} is left.",
            hint="A mapping file gives a column scale = -1, or another joint's number. Or turn the axis in the model.",
        )
