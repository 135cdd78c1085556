"""What the exact and the sparse regressor share: checked input, scaling, hyperparameters, prediction."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from copy import copy
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_array, check_consistent_length, check_is_fitted, validate_data

from gpcorrect.errors import DataError
from gpcorrect.gpr.kernels import component_masks
from gpcorrect.gpr.learning import KernelOption, Learned, Scaling, learn
from gpcorrect.gpr.predictor import Predictor, SharedPredictor
from gpcorrect.types import FloatArray, IntArray, Progress


class GaussianProcess(MultiOutputMixin, RegressorMixin, BaseEstimator):  # type: ignore[misc]  # untyped
    """Regression of outputs that share kernels by groups and have each their own signal and noise variance.

    Subclasses find the posterior of given data under given hyperparameters.

    Attributes
    ----------
    learned_ : tuple of Learned, Kernel, variances and units of each group of outputs
    predictor_ : Predictor, the posterior in the form of the hot path
    """

    feature_groups: Sequence[Sequence[int]] | None
    output_groups: Sequence[int] | None
    n_learn: int
    kernel: KernelOption
    random_state: int | None
    _most_samples: int | None = None  # that the posterior can bear; None for any number

    def fit(
        self,
        X: ArrayLike,
        y: ArrayLike,
        groups: ArrayLike | None = None,
        times: ArrayLike | None = None,
        progress: Progress | None = None,
    ) -> Self:
        """Learn hyperparameters from a subset of the samples, then the posterior from all of them.

        Parameters
        ----------
        X : (n, d) array, inputs
        y : (n,) or (n, m) array, outputs
        groups : (n,) array, optional
            Trajectory of each sample. When given, the hyperparameters allow for noise that neighbouring samples of
            one trajectory have in common, as real recordings have; without it the noise is taken as white.
        times : (n,) array, optional, seconds: the common noise then fades with the lag
        progress : Progress, optional, updated with how far the fit is

        Raises
        ------
        DataError
            More samples than the method can bear, or groups, times or output groups that do not fit.
        """
        return self._fit(X, y, groups, times, progress or Progress(), None)

    def refit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Return a copy with the same hyperparameters and the posterior of other data of the same kind.

        Parameters
        ----------
        X, y : (n, d), and (n,) or (n, m) arrays
        """
        check_is_fitted(self, "predictor_")
        other = copy(self)
        inputs, outputs = other._validated(X, y, reset=False)
        other.predictor_ = other._predictor(inputs, outputs, self._generators()[1], Progress())
        return other

    def relearn(
        self, X: ArrayLike, y: ArrayLike, groups: ArrayLike | None = None, times: ArrayLike | None = None
    ) -> Self:
        """Return a copy fitted to other data of the same kind, whose search starts at this kernel's hyperparameters.

        Parameters
        ----------
        X, y, groups, times
            As for :meth:`fit`.

        Raises
        ------
        DataError
            The model was fitted with groups or times and these data have none, or the other way round.
        """
        check_is_fitted(self, "predictor_")
        return copy(self)._fit(X, y, groups, times, Progress(), self.learned_)

    def predict(self, X: ArrayLike, return_std: bool = False) -> Any:
        """Return the mean `(n,)` or `(n, m)`, with `return_std` also the standard deviation of a new observation.

        Parameters
        ----------
        X : (n, d) array, inputs
        return_std : bool
        """
        check_is_fitted(self, "predictor_")
        mean, std, _ = self.predictor_.mean_std_batch(validate_data(self, X, reset=False, dtype=np.float64))
        if self._one_output:
            mean, std = mean[:, 0], std[:, 0]
        return (mean, std) if return_std else mean

    def _fit(
        self,
        X: ArrayLike,
        y: ArrayLike,
        groups: ArrayLike | None,
        times: ArrayLike | None,
        progress: Progress,
        starts: Sequence[Learned] | None,
    ) -> Self:
        inputs, outputs = self._validated(X, y, reset=True)
        labels, seconds = _stretches(inputs, groups, times)
        learning, placing = self._generators()
        rows = np.sort(learning.permutation(len(inputs))[: self.n_learn])
        stretches = (None if labels is None else labels[rows], None if seconds is None else seconds[rows])
        masks = component_masks(inputs.shape[1], self.feature_groups)
        learned = []
        for i, columns in enumerate(_columns(outputs.shape[1], self.output_groups)):
            scaling = Scaling.of(inputs, outputs[:, columns])
            A, B = inputs[rows] / scaling.x_spread, scaling.outputs(outputs[rows, columns])
            options: dict[str, Any] = {"kernel": self.kernel}
            if starts is not None:
                known = starts[i].hyperparameters
                options = {"start": known.theta, "kernel": known.kernel.name}
            learned.append(Learned(columns, scaling, learn(A, B, masks, *stretches, **options, progress=progress)))
        self.learned_: tuple[Learned, ...] = tuple(learned)
        self.predictor_ = self._predictor(inputs, outputs, placing, progress)
        return self

    def _predictor(self, X: FloatArray, Y: FloatArray, rng: np.random.Generator, progress: Progress) -> Predictor:
        parts = [self._posterior(part, X, Y[:, part.columns], rng, progress) for part in self.learned_]
        return Predictor(tuple(parts))

    @abstractmethod
    def _posterior(
        self, learned: Learned, X: FloatArray, Y: FloatArray, rng: np.random.Generator, progress: Progress
    ) -> SharedPredictor:
        """Posterior of inputs `(n, d)` and one group's outputs `(n, m)` under what was learned of them."""

    def _validated(self, X: ArrayLike, y: ArrayLike, *, reset: bool) -> tuple[FloatArray, FloatArray]:
        checked = validate_data(
            self, X, y, reset=reset, multi_output=True, y_numeric=True, dtype=np.float64, ensure_min_samples=2
        )
        inputs, outputs = (np.asarray(part, dtype=np.float64) for part in checked)
        if self._most_samples is not None and len(inputs) > self._most_samples:
            raise DataError(
                f"{type(self).__name__} takes at most {self._most_samples} samples, got {len(inputs)}.",
                hint="Use SparseGPR.",
            )
        self._one_output = outputs.ndim == 1
        return inputs, outputs.reshape(len(outputs), -1)

    def _generators(self) -> list[np.random.Generator]:
        """Return one generator for the hyperparameters, one for the posterior: a refit repeats the latter."""
        seed = check_random_state(self.random_state).randint(2**31 - 1)
        return np.random.default_rng(seed).spawn(2)


class ExactGPR(GaussianProcess):
    """Gaussian-process regression from the whole covariance of the data (Rasmussen and Williams 2006, Eq. 2.23).

    Parameters
    ----------
    feature_groups : sequence of sequences of int, optional
        Columns of X that act in part by themselves (pose; velocity): each group adds a component to the kernel.
    output_groups : sequence of int, optional
        How many outputs in turn share a kernel, as (3, 3) for positions and rotations; all of them by default.
    n_learn : int, samples that the hyperparameters are learned from
    kernel : "rbf", "matern52" or "auto"
        Correlation function; "auto" takes, for each group of outputs, the one of greater evidence.
    random_state : int, RandomState or None, seed of the subset

    See Also
    --------
    GaussianProcess : the attributes.
    SparseGPR : for more samples.
    """

    _most_samples = 6000  # the spectrum of more takes minutes and a gigabyte

    def __init__(
        self,
        feature_groups: Sequence[Sequence[int]] | None = None,
        output_groups: Sequence[int] | None = None,
        n_learn: int = 1000,
        kernel: KernelOption = "rbf",
        random_state: int | None = 0,
    ) -> None:
        self.feature_groups = feature_groups
        self.output_groups = output_groups
        self.n_learn = n_learn
        self.kernel = kernel
        self.random_state = random_state

    def _posterior(
        self, learned: Learned, X: FloatArray, Y: FloatArray, rng: np.random.Generator, progress: Progress
    ) -> SharedPredictor:
        """With `R = Q diag(lambda) Q^T`, `(R + nu I)^-1 = Q diag(1 / (lambda + nu)) Q^T` for every noise ratio nu."""
        kernel, scaling, found = learned.kernel, learned.scaling, learned.hyperparameters
        eigenvalues, Q = np.linalg.eigh(kernel(X, X))
        spread = np.maximum(eigenvalues, 0.0)[:, None] + found.noise / found.signal
        alpha = Q @ ((Q.T @ scaling.outputs(Y)) / spread)
        progress.step("posterior", 1.0)
        return SharedPredictor(
            kernel=kernel,
            basis=X,
            alpha=(alpha * scaling.y_spread).T,
            offset=scaling.y_centre,
            projection=Q.T,
            explained=(1.0 / spread).T,
            signal=learned.signal,
            noise=learned.noise,
        )


def _stretches(
    X: FloatArray, groups: ArrayLike | None, times: ArrayLike | None
) -> tuple[IntArray | None, FloatArray | None]:
    """Check and number the groups; check the times."""
    if groups is None:
        if times is not None:
            raise DataError("times need groups: which samples are of one trajectory?", hint="Pass groups= as well.")
        return None, None
    groups = np.asarray(groups)
    check_consistent_length(X, groups)
    labels: IntArray = np.unique(groups, return_inverse=True)[1]
    if times is None:
        return labels, None
    seconds: FloatArray = check_array(times, ensure_2d=False, dtype=np.float64, input_name="times")
    check_consistent_length(X, seconds)
    return labels, seconds


def _columns(n_outputs: int, sizes: Sequence[int] | None) -> list[slice]:
    """Slices of the outputs, a group each."""
    sizes = (n_outputs,) if sizes is None else tuple(sizes)
    if sum(sizes) != n_outputs or min(sizes) < 1:
        raise DataError(f"output groups of {sizes} outputs do not make {n_outputs} outputs.")
    stops = np.cumsum(sizes).tolist()
    return [slice(stop - size, stop) for size, stop in zip(sizes, stops, strict=True)]
