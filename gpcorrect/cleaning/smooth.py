"""The smooth model of the error: how far each error is from what such commands show elsewhere in the recording.

Systematic errors (stretch, play, friction) depend smoothly on the commanded position and velocity; a fault does not.
What differs from the smooth model by many robust scales is suspicious. The model sees commands only, which faults
leave intact. It is coarse and robust: it classifies samples, and the correction is learned elsewhere.

Three things keep faults out of it: the start is the trend of least median of squares; a stretch of the recording is
predicted from the *other* stretches only, so that a long block of faults cannot vouch for itself; and samples far from
their prediction are left out of the next round.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from gpcorrect.cleaning.least_median import least_median_plane
from gpcorrect.cleaning.settings import CleaningSettings
from gpcorrect.cleaning.signals import Samples
from gpcorrect.gpr import AdditiveRBF, WithLinear, conditioned, conditioned_mean, conditioned_on_others
from gpcorrect.rigid.registration import evenly_spaced
from gpcorrect.robust import robust_scale
from gpcorrect.types import BoolArray, FloatArray, IntArray, frozen_array

# The constants here were chosen by hand on the simulated recordings of bench/cleaning_faults.py.
CLASSIFIED_SAMPLES = 4000  # the field is smooth along a path: between these it is interpolated
FOLDS = 10  # a block of faults shorter than a tenth of the recording is predicted without it
SEARCH_SAMPLES = 300  # that the kernel is chosen on: time grows with the cube, and coarse is enough
ROUNDS = 2  # of leaving out samples that the other folds do not confirm
TINY = 1e-12  # below it a residual is zero but for rounding
STILL = 1e-9  # m/s, rad/s: slower is at rest
GRID = {"length": (0.5, 1.0, 2.0, 4.0, 8.0), "noise": (1e-3, 1e-2, 1e-1), "velocity": (0.3, 1.0, 3.0)}


@dataclass(frozen=True, eq=False)
class Residual:
    """What the smooth model leaves of the errors of n samples."""

    left: FloatArray  # (n, g, w) error less the model's, m and rad; in training, the model of the other folds
    along: FloatArray  # (n, g, w) the same by one model throughout, so that steps in it are steps of the error
    distance: FloatArray  # (n,) robust scales between error and model, of the worst group
    scale: FloatArray  # (g,) typical robust standard deviation of a component about the model, m and rad

    @classmethod
    def without_model(cls, error: FloatArray) -> Self:
        """Return the residual (n, g, w) of a recording without a model: nothing is expected, so nothing is far.

        Parameters
        ----------
        error : (n, g, w) array, m and rad
        """
        return cls(error, error, np.zeros(len(error)), np.full(error.shape[1], np.inf))


@dataclass(frozen=True)
class _Hyper:
    """Hyperparameters of the field: length scale in spreads, noise over signal variance, weight of velocities.

    Beside the bend runs a line, as wide as it: in few trajectories the other folds do not surround a stretch, and a
    field that fell back to zero there would condemn it (of 10 simulated reaches the line keeps 709 of 846 samples,
    without it 605).
    """

    length: float = 2.0
    noise: float = 0.03
    velocity: float = 1.0

    def kernel(self, n_place: int, n_velocity: int) -> WithLinear:
        weights = np.repeat([1.0, self.velocity], (n_place, n_velocity))
        return WithLinear(AdditiveRBF(np.ones(1), self.length / weights[None]), frozen_array(weights**2))


@dataclass(frozen=True, eq=False)
class InputScaling:
    """Scaling of the commands, learned once: each group by one number, so that no choice of axes matters."""

    centre: tuple[FloatArray, ...]  # (k,) each: middle of each group of coordinates
    spread: FloatArray  # (groups,) spread of each
    # (groups,) speeds, m/s and rad/s, at which a velocity input is half saturated: friction depends on the direction of
    # motion more than on its speed
    speed: FloatArray

    @classmethod
    def learn(cls, samples: Samples, settings: CleaningSettings) -> Self:
        """Return the scaling of these samples, by medians; a spread below the resolution is noise.

        Parameters
        ----------
        samples : Samples, n samples
        settings : CleaningSettings, factors and floors
        """
        least = settings.resolution(samples.units if samples.joints else "PR")
        centre = tuple(frozen_array(np.median(place, axis=0)) for place in samples.place)
        away = [np.linalg.norm(place - c, axis=1) for place, c in zip(samples.place, centre, strict=True)]
        speeds = [np.linalg.norm(velocity, axis=1) for velocity in samples.velocity]
        typical = [np.median(v[v > STILL]) if (v > STILL).any() else 1.0 for v in speeds]
        return cls(
            centre,
            frozen_array([max(np.median(a), f) for a, f in zip(away, least, strict=False)]),
            frozen_array(typical),
        )

    def transform(self, samples: Samples) -> tuple[FloatArray, int]:
        """Return inputs (n, d), coordinates before velocities, and the number of coordinates among them.

        Parameters
        ----------
        samples : Samples, n samples
        """
        scaled = [(p - c) / s for p, c, s in zip(samples.place, self.centre, self.spread, strict=True)]
        saturated = [
            v / (np.linalg.norm(v, axis=1, keepdims=True) + s)
            for v, s in zip(samples.velocity, self.speed, strict=True)
        ]
        return np.hstack([*scaled, *saturated]), sum(part.shape[1] for part in scaled)


@dataclass(frozen=True, eq=False)
class SmoothModel:
    """Trend, field and scale of the systematic error."""

    scaling: InputScaling  # inputs of the field
    # (r, w) each: for each group, slopes and level of its error over commanded position and velocity (an arm that
    # follows late errs in proportion to its velocity), found by least median of squares
    trend: tuple[FloatArray, ...]
    unit: FloatArray  # (g,) robust spread of what the trend leaves, m and rad: the field's unit
    # (m, d) and (m, g w) samples that the field is conditioned on
    inputs: FloatArray
    outputs: FloatArray
    kernel: WithLinear  # covariance of the field
    noise: float  # variance that position and velocity do not explain (noise, play), over that of the field
    scale: FloatArray  # (g,) robust standard deviation of a component about the field, as a multiple of the field's own
    # (2, r - 1) each: for each group, least and largest position and velocity that the trend is followed to: a training
    # range beyond the training. The slope of a joint that hardly moved is noise, and far away that noise is metres.
    # Empty in older files, whose trend has no end.
    reach: tuple[FloatArray, ...] = ()

    def residual(self, samples: Samples) -> Residual:
        """Return what the model leaves of each error.

        Parameters
        ----------
        samples : Samples, n samples
        """
        rows = _classified_rows(samples)
        X, _ = self.scaling.transform(samples)
        mean, deviation = conditioned(self.kernel, self.noise, self.inputs, self.outputs, X[rows])
        return self.beside(_scaled(samples, self.trend, self.reach, self.unit), rows, mean, deviation)

    def beside(self, left: FloatArray, rows: IntArray, mean: FloatArray, deviation: FloatArray) -> Residual:
        """Hold scaled errors `left` (n, g, w) against a mean (m, g w) and deviation (m,) that are known at `rows`.

        Far from all training samples the deviation is large, so that ignorance does not condemn a sample.

        Parameters
        ----------
        left : (n, g, w) array, errors less the trend, in its units
        rows : (m,) array, where the field was evaluated
        mean : (m, g w) array, its mean there
        deviation : (m,) array, its standard deviation there, noise included
        """
        unexplained = _less_field(left, rows, mean)
        deviation = np.interp(np.arange(len(left)), rows, deviation / np.sqrt(self.noise))[:, None]
        distance = (np.linalg.norm(unexplained, axis=2) / (deviation * self.scale)).max(axis=1)
        remainder = unexplained * self.unit[:, None]
        return Residual(remainder, remainder, distance, self.unit * self.scale * np.median(deviation))


@dataclass(frozen=True, eq=False)
class _Data:
    """Inputs (n, d) and scaled errors (n, g w) of some samples, the fold that each lies in, and the sizes."""

    X: FloatArray
    Y: FloatArray
    fold: IntArray
    width: int
    sizes: tuple[int, int]

    def __getitem__(self, rows: IntArray | BoolArray) -> _Data:
        return replace(self, X=self.X[rows], Y=self.Y[rows], fold=self.fold[rows])

    def lengths(self, mean: FloatArray, deviation: FloatArray | float) -> FloatArray:
        """Lengths (n, g) of what a mean leaves, over the deviation (n,)."""
        left = (self.Y - mean).reshape(len(mean), -1, self.width)
        return np.asarray(np.linalg.norm(left, axis=2) / np.broadcast_to(deviation, len(mean))[:, None])


def learn_smooth_model(
    samples: Samples, trusted: BoolArray, settings: CleaningSettings, rng: np.random.Generator
) -> tuple[SmoothModel, Residual]:
    """Return the model of the trusted samples, and what the other folds' models leave of every sample.

    Parameters
    ----------
    samples : Samples, n samples, faults among them
    trusted : (n,) bool array, false for samples that broke a limit
    settings : CleaningSettings, factors and floors
    rng : numpy Generator, source of the random samples of the trend
    """
    resolution = settings.resolution(samples.units)
    rows = np.flatnonzero(trusted)
    rows = rows[evenly_spaced(len(rows), settings.field_samples)]
    inputs = [samples.trend_inputs(group)[rows] for group in range(len(samples.units))]
    planes = [least_median_plane(x, samples.error[rows, group], rng) for group, x in enumerate(inputs)]
    trend = tuple(frozen_array(plane) for plane, _ in planes)
    ends = [(np.min(x, axis=0), np.max(x, axis=0)) for x in inputs]
    reach = tuple(frozen_array([2 * low - high, 2 * high - low]) for low, high in ends)
    unit = np.maximum([scales[0] for _, scales in planes], resolution)
    scaling = InputScaling.learn(samples, settings)
    X, n_place = scaling.transform(samples)
    left = _scaled(samples, trend, reach, unit)
    data = _Data(X, left.reshape(len(X), -1), _folds(samples), left.shape[2], (n_place, X.shape[1] - n_place))
    train, hyper = _confirmed(data[rows], settings.offset_factor)
    asked = _classified_rows(samples)
    mean, deviation = _cross_predict(train, data[asked], hyper)
    chosen = trusted[asked]
    lengths = data[asked].lengths(mean, deviation / np.sqrt(hyper.noise))
    scale = robust_scale(lengths[chosen], data.width) * samples.small_sample_factor
    model = SmoothModel(
        scaling,
        trend,
        frozen_array(unit),
        frozen_array(train.X),
        frozen_array(train.Y),
        hyper.kernel(*data.sizes),
        hyper.noise,
        frozen_array(np.maximum(scale, resolution / unit)),
        reach,
    )
    others = model.beside(left, asked, mean, deviation)
    throughout = conditioned_mean(model.kernel, model.noise, model.inputs, model.outputs, X[asked])
    return model, replace(others, along=_less_field(left, asked, throughout) * model.unit[:, None])


def _less_field(left: FloatArray, rows: IntArray, mean: FloatArray) -> FloatArray:
    """Return scaled errors `left` (n, g, w) less the field, whose mean (m, g w) is known at `rows`."""
    index = np.arange(len(left))
    field: FloatArray = np.stack([np.interp(index, rows, column) for column in mean.T], axis=1).reshape(left.shape)
    return left - field


def _scaled(
    samples: Samples, trend: tuple[FloatArray, ...], reach: tuple[FloatArray, ...], unit: FloatArray
) -> FloatArray:
    """Return what the trend leaves of the error (n, g, w), in units (g,) of its spread."""
    inputs = [samples.trend_inputs(group) for group in range(len(trend))]
    if reach:
        inputs = [np.clip(part, *ends) for part, ends in zip(inputs, reach, strict=True)]
    expected = [part @ plane[:-1] + plane[-1] for part, plane in zip(inputs, trend, strict=True)]
    return samples.centred(samples.error - np.stack(expected, axis=1)) / unit[:, None]


def _folds(samples: Samples) -> IntArray:
    """Fold (n,) of each sample: stretches of consecutive whole trajectories, or of time where there are few of them."""
    starts = np.concatenate([[0], np.cumsum(np.diff(samples.trajectory) != 0)])
    if starts[-1] + 1 >= FOLDS:
        return np.asarray(starts * FOLDS // (starts[-1] + 1))
    return np.arange(len(samples)) * FOLDS // len(samples)


def _classified_rows(samples: Samples) -> IntArray:
    """Rows at which the model is evaluated: evenly spaced, and both ends of every trajectory and run."""
    n = len(samples)
    ends = np.flatnonzero((np.diff(samples.trajectory) != 0) | (np.diff(samples.run) != 0))
    stride = max(1, n // CLASSIFIED_SAMPLES)
    return np.unique(np.concatenate([np.arange(0, n, stride), ends, ends + 1, [n - 1]]))


def _confirmed(train: _Data, factor: float) -> tuple[_Data, _Hyper]:
    """Training samples that the model of the other folds confirms, and the hyperparameters that predict them best."""
    confirmed: BoolArray = np.all(train.lengths(np.zeros(train.Y.shape), 1.0) <= factor, axis=1)
    hyper = _best_hyper(train[confirmed])
    for _ in range(ROUNDS):
        lengths = train.lengths(*_cross_predict(train[confirmed], train, hyper))
        confirmed = np.all(lengths <= factor * np.maximum(robust_scale(lengths, train.width), TINY), axis=1)
    return train[confirmed], hyper


def _cross_predict(train: _Data, asked: _Data, hyper: _Hyper) -> tuple[FloatArray, FloatArray]:
    """Mean (n, g w) and deviation (n,) at the asked samples, each from the training samples of the other folds."""
    kernel = hyper.kernel(*train.sizes)
    return conditioned_on_others(kernel, hyper.noise, (train.X, train.Y, train.fold), (asked.X, asked.fold))


def _best_hyper(train: _Data) -> _Hyper:
    """Hyperparameters of least median error on the other folds, one after the other."""
    few = train[evenly_spaced(len(train.Y), SEARCH_SAMPLES)]

    def median_error(hyper: _Hyper) -> float:
        lengths = few.lengths(_cross_predict(few, few, hyper)[0], 1.0)
        return float(np.log(np.maximum(np.median(lengths, axis=0), TINY)).sum())

    best = _Hyper()
    for name, values in GRID.items():
        best = min((replace(best, **{name: value}) for value in values), key=median_error)
    return best
