"""A log as a task sees it: inputs of the learner, what it is to predict, unbroken paths, what is held out together."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Self

import numpy as np
from scipy.special import stdtrit  # scipy.stats has it too, and takes half a second to import

from gpcorrect.calibration.metrics import Z95
from gpcorrect.calibration.settings import LIMITS
from gpcorrect.errors import DataError, LogError
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Samples:
    """All n samples of a log, incomplete ones included: paths go through them."""

    time: FloatArray  # (n,) s
    trajectory: IntArray  # (n,) as in the log
    new: BoolArray  # (n,) where an unbroken path begins: nothing is known of what the arm did before
    X: FloatArray  # (n, d) inputs of the learner; NaN in rows that lack one
    target: FloatArray  # (n, m) what the learner is to predict; NaN where unknown
    # (n, m) what the target is counted from, beyond the correction itself: 0, or the input for a learner of true
    # positions
    origin: FloatArray
    usable: BoolArray  # (n,) rows that may be learned from: complete, and not rejected
    # (n, d) joints that go in, for learners that filter a path; empty where there are none
    path: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    effort: FloatArray | None = None  # (n, d) efforts, likewise
    # (n, d) by how much inputs may be off, see :meth:`JointFeatures.unsure`; None where all are known
    unsure: FloatArray | None = None
    session: IntArray | None = None  # (n,) as in the log; None where it does not matter

    def __len__(self) -> int:
        return len(self.time)

    @property
    def rows(self) -> IntArray:
        """Rows `(k,)` that may be learned from."""
        return np.flatnonzero(self.usable)

    @property
    def motions(self) -> int:
        """How many motions may be learned from: trajectories, each cut where it is longer than a piece."""
        rows = self.rows
        return len(np.unique(pieces(self.time[rows], self.trajectory[rows])))

    @property
    def widening(self) -> float:
        """By how much intervals that so many motions tell of are too narrow, see :func:`of_few`.

        A lone motion, of which the parts tell of each other, is taken for two.
        """
        return of_few(max(self.motions, 2))

    @property
    def sessions_left_out(self) -> IntArray | None:
        """Session `(k,)` of each row that may be learned from; None where so few are no folds: half would be left."""
        counts = np.zeros(0) if self.session is None else np.unique(self.session[self.rows], return_counts=True)[1]
        if self.session is None or len(counts) < LIMITS.fewest_sessions or 2 * counts.max() > counts.sum():
            return None
        return self.session[self.rows]

    @property
    def folds(self) -> IntArray:
        """Fold `(k,)` of each row that may be learned from: of sessions, for the next will be new; of trajectories."""
        sessions = self.sessions_left_out
        return folds_of(self.trajectory[self.rows] if sessions is None else sessions)

    def without(self, rows: BoolArray | IntArray) -> Self:
        """Return the same samples, of which `rows` may not be learned from.

        Parameters
        ----------
        rows : (n,) mask or (k,) int array, samples to leave out
        """
        usable = self.usable.copy()
        usable[rows] = False
        return replace(self, usable=usable)

    def learnable(self) -> tuple[FloatArray, FloatArray]:
        """Return inputs `(k, d)` and targets `(k, m)` to learn from."""
        rows, fewest = self.rows, LIMITS.fewest_samples
        if len(rows) < fewest:
            complete = np.isfinite(self.X).all(axis=1) & np.isfinite(self.target).all(axis=1)
            raise DataError(
                f"only {len(rows)} of {len(self)} samples can be learned from; at least {fewest} are needed.",
                hint=too_few_hint(len(self), rejected=bool((complete & ~self.usable).any())),
            )
        return self.X[rows], self.target[rows]


def of_few(count: int) -> float:
    """Return by how much an interval is too narrow for another draw: Student's t for 1.96, and the mean's own spread.

    Parameters
    ----------
    count : int, draws, two or more, that its deviation was learned from
    """
    return float(stdtrit(count - 1, 0.975) * np.sqrt(1 + 1 / count)) / Z95


@dataclass(frozen=True, eq=False)
class Layout:
    """How inputs and targets of a task are grouped, for the learners."""

    targets: tuple[int, ...]  # how many targets in turn belong together: they have one kernel and one bound
    # columns that act in part by themselves (pose; velocity), each a component of the kernel; None for one
    inputs: tuple[tuple[int, ...], ...] | None
    smooth: IntArray  # (k,) columns on which the targets may depend in a curved way
    # (d, m) ridge penalties of a linear law that comes before the Gaussian process; None for a task without one
    penalties: FloatArray | None
    slack: FloatArray  # (d,) how far outside its training range an input may always be
    inducing: int  # points of the Gaussian process where the settings say nothing
    fading: IntArray  # (f,) columns, velocities, whose linear effect fades outside the training range
    # columns that say where the arm is, as joints or as a pose; of those and of efforts: all that is not of the past
    place: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    present: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    # columns that are efforts, and velocities of the joints that have them
    efforts: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    velocities: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))


def too_few_hint(count: int, *, rejected: bool, static: bool = False) -> str:
    """Return what to do where too few samples can be learned from.

    Parameters
    ----------
    count : int, samples that there are
    rejected : bool, whether cleaning rejected some
    static : bool, whether they are poses without a clock
    """
    if count < LIMITS.fewest_samples:
        what = "poses or more, spread over where the robot will work" if static else "samples or more"
        return f"Record {LIMITS.few_recorded} {what}: a fifth of them is held out, to measure the model on."
    keep = "; or keep everything: --no-clean" if rejected else ""
    return f"Look at what is wrong with the recording: gpcorrect validate LOG{keep}"


def path_starts(time: FloatArray, session: IntArray, known: BoolArray) -> BoolArray:
    """Return where unbroken paths begin `(n,)`: after a pause, a homing, or samples whose input is not known.

    A slack goes on from one motion to the next, so motions that follow each other are one path.

    Parameters
    ----------
    time : (n,) array, s
    session : (n,) int array, homing or day
    known : (n,) mask, where the input is known
    """
    step = np.diff(time, prepend=time[:1])
    apart = (step > pause(step[1:])) | (step < 0)
    homed = np.diff(session, prepend=session[:1]) != 0
    before = np.concatenate([[False], known])[:-1]
    return np.asarray(apart | homed | ~known | ~before)


def pause(steps: FloatArray) -> float:
    """Return the longest wait, s, over which a path goes on.

    Parameters
    ----------
    steps : (n,) array, s between samples
    """
    return max(LIMITS.pause_steps * float(np.median(steps)) if len(steps) else 0.0, LIMITS.pause_seconds)


def clocks(time: FloatArray, session: IntArray) -> IntArray:
    """Return the number `(n,)` of each sample's clock: one a session, or more where it starts again at each motion.

    Parameters
    ----------
    time : (n,) array, s
    session : (n,) int array, homing or day
    """
    return np.cumsum((np.diff(time, prepend=-np.inf) <= 0) | (np.diff(session, prepend=session[:1]) != 0))


def pieces(time: FloatArray, trajectory: IntArray, longest: float = LIMITS.piece_seconds) -> IntArray:
    """Return the number `(n,)` of each sample's piece: trajectories in order, cut where they are longer than a piece.

    Parameters
    ----------
    time : (n,) array, s
    trajectory : (n,) int array, which motion
    longest : float, of a piece, in the unit of `time`
    """
    begins = np.diff(trajectory, prepend=trajectory[:1] - 1) != 0
    first = np.maximum.accumulate(np.where(begins, np.arange(len(time)), 0))
    inside = ((time - time[first]) // longest).astype(np.int64)
    return np.cumsum(begins | (np.diff(inside, prepend=0) != 0)) - 1


class HoldOut(StrEnum):
    """What is held out whole."""

    AUTO = "auto"
    TRAJECTORY = "trajectory"
    SESSION = "session"
    BLOCK = "block"


def held_out(
    log: CalibrationLog, holdout: float, by: HoldOut = HoldOut.AUTO, *, rng: np.random.Generator | None = None
) -> BoolArray:
    """Return which samples `(n,)` to measure on: the last fraction of whole units, or a random one.

    Parameters
    ----------
    log : CalibrationLog, n samples
    holdout : float, fraction of the units to measure on; 0 for none
    by : HoldOut
        What the units are; AUTO takes trajectories, and blocks of time where there is one or the poses are static.
    rng : numpy.random.Generator, optional, draws the units; the last ones are taken without it
    """
    if not 0 <= holdout < 1:
        raise DataError(f"the held-out fraction must be at least 0 and below 1, got {holdout}.")
    if holdout == 0:
        return np.zeros(len(log), dtype=bool)
    blocks = (log.static or len(log.trajectory_ids) < 2) if by is HoldOut.AUTO else by is HoldOut.BLOCK
    if blocks:
        units: IntArray = np.arange(len(log)) * 5 * LIMITS.folds // max(len(log), 1)
    else:
        units = in_order(log.session if by is HoldOut.SESSION else log.trajectory)
    names = np.unique(units)
    if len(names) < 2:
        raise LogError(
            f"the log holds one {by if by is not HoldOut.AUTO else 'sample'}: nothing can be held out to measure on.",
            hint="Number the motions in the `trajectory` column, give more logs, or measure nothing: --holdout 0",
            path=log.name,
        )
    if rng is not None:
        names = rng.permutation(names)
    count = min(len(names) - 1, max(1, round(holdout * len(names))))
    return np.isin(units, names[-count:])


def folds_of(trajectory: IntArray) -> IntArray:
    """Fold `(n,)` of each sample: neighbouring whole trajectories, or blocks of time when there are fewer than two.

    Neighbours are left out together, for an arm changes slowly: a trajectory between two that were learned from is
    predicted better than any to come. (Taken in turn they gave intervals on simulated debridement that covered 79 to
    85 % of the worst axis of later trajectories, blocks 87 to 97 %.)

    Parameters
    ----------
    trajectory : (n,) int array, in recorded order; or sessions
    """
    order = in_order(trajectory)
    count = int(order.max(initial=0)) + 1
    if count < 2:
        return np.arange(len(trajectory)) * LIMITS.folds // max(len(trajectory), 1)
    return order * min(LIMITS.folds, count) // count


def evenly_spread(n: int, most: int) -> IntArray:
    """Return at most so many rows of n, spread evenly over the recording.

    Parameters
    ----------
    n, most : int
    """
    return np.unique(np.linspace(0, n - 1, min(n, most)).astype(np.int64))


def in_order(labels: IntArray) -> IntArray:
    """Return labels `(n,)` as numbers 0, 1... in the order in which they first come."""
    _, first, index = np.unique(labels, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[index]
