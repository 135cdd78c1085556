"""Fine search: the shift at which the reference explains the observed positions best, and how sure that is.

The model is `y(s) = A x(s - d) + b + noise`: y the observed position at its stamp s, x the reference's columns
(position, and the entries of its rotation matrix) and where in a slack each of them stands, A and b free. A free matrix
contains every rotation, scale and unit between the frames, the rotation columns contain every lever arm between the two
points, and the fit stays linear: the registration need not be known, and no registration can hide in the shift. Slack
between motors and tool makes the tool late, as a clock does, but at reversals alone, which its columns take up. Only
the reference is interpolated: interpolating a noisy signal averages its noise between samples, which draws the estimate
towards half sample steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import Akima1DInterpolator
from scipy.special import stdtrit  # scipy.stats has it too, and takes half a second to import

from gpcorrect.logs.streams import default_max_gap
from gpcorrect.logs.sync.motion import Motion, MotionPair
from gpcorrect.play import play_states
from gpcorrect.robust import robust_scale
from gpcorrect.types import BoolArray, FloatArray, IntArray

HUBER = 2.0  # robust standard deviations up to which a residual counts in full
MAX_STEPS = 40  # of Gauss and Newton; converging takes about ten
MIN_INFORMATION = 1e-3  # of the velocity must be out of the reach of a constant registration
MIN_SHARE = 1e-3  # of the usual information: a part of a recording with less says nothing by itself
FREE_STEPS = 8  # then the noise scale and the samples compared are held, or they and the shift could cycle
TOLERANCE = 0.02  # standard errors (of white noise); a smaller step changes nothing
FLOOR = 1e-9  # s; the same for noise-free data
RANK = 1e-13  # of the largest eigenvalue; smaller ones are combinations of columns that do not move
NOISE_FLOOR = 1e-9  # noise-free data: residuals below this fraction of the spread are rounding
MIN_KNOTS = 5  # of an Akima spline
REACH = 2  # Akima's slope at a knot looks at two intervals on either side
STILL = 1e-9  # a column that spreads less than this fraction of the widest one has only rounding in it
MIN_BLOCKS, MAX_BLOCKS = 12, 200  # fewer tell no variance, more cost time; chosen by hand
SLACKS = (0.1, 0.3)
"""Half widths of slack, in standard deviations of a column, of which any other is nearly a sum. On a simulated tendon
arm (clock 80 ms, 114 found without them) 101, 100 and 103 ms with these, half and twice of them."""
BLOCK_TIMES = 6.0  # a block is this many correlation times long: sums of blocks are then all but independent


@dataclass(frozen=True, eq=False)
class Sampled:
    """Reference columns `(n, m)` and their time derivatives at n times; rows count where `valid` (n,)."""

    values: FloatArray
    derivatives: FloatArray
    valid: BoolArray


@dataclass(frozen=True, eq=False)
class Refinement:
    """A local optimum of the shift."""

    timing: FloatArray  # (p,) shift in s at the epoch and, where fitted, its drift in s/s
    covariance: FloatArray  # (p, p) of the timing, from sums over blocks of samples
    dof: int  # degrees of freedom of the covariance: blocks less parameters
    explained: float  # fraction of the observed spread that the reference explains
    # fraction of the observed velocity that no constant A, b could imitate; 0 means that a shift looks like another
    # registration
    information: float
    valid: BoolArray  # (n,) observed samples that were compared
    residual: FloatArray  # (n, k) observed less modelled, 0 where not valid
    scale: FloatArray  # (k,) robust standard deviation of the residual
    # (n, p) and (n, p, p), what each sample adds to the normal equations of the timing
    score: FloatArray
    hessian: FloatArray

    def loss(self, scale: FloatArray) -> FloatArray:
        """Huber loss of each sample `(n,)` for noise of these standard deviations `(k,)`.

        Parameters
        ----------
        scale : (k,) array, of each observed column
        """
        size = _size(self.residual, scale)
        return np.where(size <= HUBER, size**2, 2 * HUBER * size - HUBER**2)

    def half_width(self) -> FloatArray:
        """(p,) half widths of the 95 % confidence intervals."""
        quantile = float(stdtrit(max(self.dof, 1), 0.975))
        return quantile * np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True, eq=False)
class _Linear:
    """The model about a timing: residual `(n, k)` and weight `(n,)`; score and Hessian as in :class:`Refinement`."""

    residual: FloatArray
    weight: FloatArray
    scale: FloatArray
    score: FloatArray
    hessian: FloatArray
    information: float


class Timing:
    """The regression of observed on shifted reference samples, of a pair for each run of the clocks.

    `epoch` is the observer's time at which the shift is quoted, s; a drift turns about it.
    """

    def __init__(self, pairs: Sequence[MotionPair], epoch: float = 0.0, *, slack: bool = True) -> None:
        self._fit_splines([p.reference for p in pairs], slack)
        self.stamps = [np.asarray(p.observed.time) for p in pairs]
        self.elapsed = np.concatenate(self.stamps) - epoch
        labels = [
            np.full(len(p.observed), i) if p.observed.label is None else p.observed.label for i, p in enumerate(pairs)
        ]
        self.label: IntArray = np.concatenate(labels)
        target = np.concatenate([p.observed.values for p in pairs])
        spread = target.std(axis=0) if len(target) else np.zeros(target.shape[1])
        moving = spread > 0
        self.target = (target - target.mean(axis=0))[:, moving] if len(target) else target
        self.floor = NOISE_FLOOR * spread[moving]
        self.epoch = epoch

    def sample(self, timing: FloatArray) -> Sampled:
        """Sample the reference at the observed stamps, moved by the timing.

        Parameters
        ----------
        timing : (p,) array, shift in s and, where there is one, drift in s/s
        """
        drift = timing[1] if len(timing) > 1 else 0.0
        moved = [s - timing[0] - drift * (s - self.epoch) for s in self.stamps]
        parts = [self._piece(i, t) for i, t in enumerate(moved)]
        values, derivatives, valid = (np.concatenate(column) for column in zip(*parts, strict=True))
        return Sampled(values, derivatives, valid)

    def _fit_splines(self, pieces: Sequence[Motion], slack: bool) -> None:
        """Put Akima splines through each piece of the reference: local, so a step disturbs its neighbourhood only.

        Columns are centred and scaled to unit spread, for well-conditioned least squares; those that do not move are
        left out.
        """
        stacked = np.concatenate([p.regressors for p in pieces])
        centre, spread = stacked.mean(axis=0), stacked.std(axis=0)
        moving = spread > STILL * max(float(spread.max()), np.finfo(float).tiny)
        parts = [((p.regressors - centre) / np.where(moving, spread, 1.0))[:, moving] for p in pieces]
        if slack:
            parts = [np.hstack([part, _slack(part)]) for part in parts]
        self.columns = int(parts[0].shape[1])
        self._knots = [p.time for p in pieces]
        # Intervals between knots that are no gap and whose slopes see none.
        gaps = [np.diff(p.time) > default_max_gap(p.time) for p in pieces]
        ones = np.ones(2 * REACH + 1)
        near = [np.convolve(gap, ones)[REACH : REACH + len(gap)] if len(gap) else gap for gap in gaps]
        self._sound = [found == 0 for found in near]
        self._splines = [
            Akima1DInterpolator(p.time, part) if len(p) >= MIN_KNOTS else None
            for p, part in zip(pieces, parts, strict=True)
        ]

    def _piece(self, i: int, t: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return values, derivatives and validity of a piece of the reference at its times (n,)."""
        spline, knots = self._splines[i], self._knots[i]
        if spline is None or not len(t):
            blank = np.zeros((len(t), self.columns))
            return blank, blank, np.zeros(len(t), dtype=np.bool_)
        interval = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2)
        valid = (t >= knots[0]) & (t <= knots[-1]) & self._sound[i][interval]
        inside = np.clip(t, knots[0], knots[-1])
        return spline(inside), spline(inside, nu=1), valid

    def enough(self, valid: BoolArray) -> bool:
        """Whether the samples in common outnumber the unknowns safely.

        Parameters
        ----------
        valid : (n,) bool array
        """
        return int(valid.sum()) >= 3 * (self.columns + 2) + MIN_BLOCKS

    def refine(self, start: FloatArray, bracket: float) -> Refinement | None:
        """Gauss-Newton on the timing with Huber weights from `start`, at most `bracket` s away.

        It ends where it stands as soon as the motion turns out to hold no information; None where it does not converge.

        Parameters
        ----------
        start : (p,) array, shift in s and, where it is fitted, drift in s/s
        bracket : float, largest change of the shift, s
        """
        timing = np.array(start, dtype=np.float64)
        weight = np.ones(len(self.target))
        scale, sampled = None, self.sample(timing)
        for count in range(MAX_STEPS):
            if not self.enough(sampled.valid):
                return None
            linear = self._linearise(sampled, weight[sampled.valid], len(timing), scale)
            weight[sampled.valid] = linear.weight
            if linear.information < MIN_INFORMATION:
                return self._result(timing, weight)
            score, hessian = linear.score.sum(axis=0), linear.hessian.sum(axis=0)
            step = np.linalg.pinv(hessian, rcond=1e-15, hermitian=True) @ score
            timing = timing + step
            sampled, held = self.sample(timing), sampled.valid
            if count >= FREE_STEPS:
                scale, sampled = linear.scale, replace(sampled, valid=held)
            if abs(timing[0] - start[0]) > bracket:
                return None
            if abs(step[0]) < max(TOLERANCE / np.sqrt(max(hessian[0, 0], 1e-300)), FLOOR):
                return self._result(timing, weight)
        return None

    def misfits(self, timings: Sequence[FloatArray]) -> FloatArray:
        """Measure what registration and each timing leave of the observed motion, on the samples that all compare.

        Parameters
        ----------
        timings : sequence of k (p,) arrays, shift in s and, where there is one, drift in s/s
        """
        samples = [self.sample(timing) for timing in timings]
        common = np.logical_and.reduce([sampled.valid for sampled in samples])
        if not self.enough(common):
            return np.full(len(samples), np.nan)
        misfits = []
        for sampled in samples:
            weight = np.ones(int(common.sum()))
            for _ in range(FREE_STEPS):
                linear = self._linearise(replace(sampled, valid=common), weight, 1, None)
                weight = linear.weight
            misfits.append(float(np.median(np.linalg.norm(linear.residual, axis=1))))
        return np.array(misfits)

    def _linearise(self, sampled: Sampled, weight: FloatArray, parameters: int, scale: FloatArray | None) -> _Linear:
        valid = sampled.valid
        y, elapsed = self.target[valid], self.elapsed[valid]
        x = np.column_stack([sampled.values[valid], np.ones(len(y))])
        # Least squares by normal equations: columns are of unit spread, and thousands of rows make all else slow.
        weighted = x.T * weight
        fit = np.linalg.pinv(weighted @ x, rcond=RANK, hermitian=True) @ weighted
        coefficient = fit @ y
        residual = y - x @ coefficient
        if scale is None:
            scale = np.maximum(robust_scale(np.abs(residual)), self.floor)
        size = _size(residual, scale)
        velocity = sampled.derivatives[valid] @ coefficient[:-1]
        gradient = [velocity, velocity * elapsed[:, None]][:parameters]
        own = [g - x @ (fit @ g) for g in gradient]
        moved = [np.sum(weight[:, None] * (part / scale) ** 2) for part in (own[0], velocity)]
        information = float(moved[0] / moved[1]) if moved[1] > 0 else 0.0
        weight, slope = np.minimum(1.0, HUBER / np.maximum(size, HUBER)), np.stack(own, axis=2) / scale[:, None]
        score = -np.einsum("n,nk,nkp->np", weight, residual / scale, slope)
        hessian = np.einsum("n,nkp,nkq->npq", weight, slope, slope)
        return _Linear(residual, weight, scale, score, hessian, information)

    def _result(self, timing: FloatArray, weight: FloatArray) -> Refinement | None:
        sampled = self.sample(timing)
        valid, p = sampled.valid, len(timing)
        if not self.enough(valid):
            return None
        linear = self._linearise(sampled, weight[valid], p, None)
        score, hessian = np.zeros((len(valid), p)), np.zeros((len(valid), p, p))
        score[valid], hessian[valid] = linear.score, linear.hessian
        residual = np.zeros(self.target.shape)
        residual[valid] = linear.residual
        covariance, dof = sandwich(linear.score, linear.hessian.sum(axis=0))
        covariance *= lost_freedom(np.clip(linear.residual / linear.scale, -HUBER, HUBER), self.columns + 1)
        target, weight = self.target[valid], linear.weight[:, None]
        spread = float(np.sum(weight * (target - np.average(target, axis=0, weights=linear.weight)) ** 2))
        explained = 1.0 - float(np.sum(weight * linear.residual**2)) / spread if spread > 0 else 0.0
        return Refinement(
            timing, covariance, dof, explained, linear.information, valid, residual, linear.scale, score, hessian
        )


def _slack(path: FloatArray) -> FloatArray:
    """Where a path `(n, m)` stands in slacks of each width, `(n, 2 m)`; it starts in their middle."""
    radii = np.outer(SLACKS, np.ones(path.shape[1]))
    steps = np.diff(path, axis=0, prepend=path[:1])
    return play_states(steps, radii, np.zeros(len(path), dtype=np.int64)).reshape(len(path), -1)


def _size(residual: FloatArray, scale: FloatArray) -> FloatArray:
    """Root mean square of each row `(n,)` in standard deviations."""
    return np.asarray(np.sqrt(np.mean((residual / scale) ** 2, axis=1)))


def sandwich(score: FloatArray, hessian: FloatArray) -> tuple[FloatArray, int]:
    """Covariance `(p, p)` of an estimate from score `(n, p)` and Hessian `(p, p)`; degrees of freedom.

    The score is summed over blocks, whose sums are independent though the samples are not (Huber's sandwich,
    clustered).

    Parameters
    ----------
    score : (n, p) array, what each sample adds to the gradient, in order of time
    hessian : (p, p) array, of the whole loss
    """
    sums = block_sums(score)
    centred = sums - sums.mean(axis=0)
    blocks, p = sums.shape
    middle = centred.T @ centred * (blocks / (blocks - p))
    bread = np.linalg.pinv(hessian, rcond=1e-15, hermitian=True)
    return bread @ middle @ bread, blocks - p


def lost_freedom(residual: FloatArray, unknowns: int) -> float:
    """Factor of the variance for noise in residuals `(n, k)` that so many other fitted unknowns took up.

    Slow noise has few independent samples, and every unknown follows one.

    Parameters
    ----------
    residual : (n, k) array, in order of time
    unknowns : int, fitted beside what the variance is of
    """
    times = [_correlation_time(column) for column in residual.T]
    free = len(residual) / float(np.median(times))
    return free / max(free - unknowns, 1.0)


def block_sums(series: FloatArray) -> FloatArray:
    """Sum rows to `(b, p)` over blocks long against the first column's correlation time.

    Parameters
    ----------
    series : (n, p) array, in order of time
    """
    n = len(series)
    length = BLOCK_TIMES * _correlation_time(series[:, 0])
    blocks = int(np.clip(n / length, min(MIN_BLOCKS, n), MAX_BLOCKS))
    edges = np.linspace(0, n, blocks + 1).astype(int)[:-1]
    return np.add.reduceat(series, edges, axis=0)


def _correlation_time(series: FloatArray) -> float:
    """Integrated autocorrelation time in samples, up to the first lag at which none is left (Sokal 1997)."""
    x = series - series.mean()
    n = len(x)
    spectrum = np.abs(np.fft.rfft(x, 2 * n)) ** 2
    covariance = np.fft.irfft(spectrum)[:n]
    if covariance[0] <= 0:
        return 1.0
    rho = covariance / covariance[0]
    gone = np.flatnonzero(rho < 0.05)
    stop = int(gone[0]) if gone.size else n
    return max(1.0, 1.0 + 2.0 * float(rho[1:stop].sum()))
