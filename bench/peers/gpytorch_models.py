"""GPyTorch: exact regression and SGPR (Titsias 2009), ARD kernel, Adam as in its own examples; a model an output."""

from __future__ import annotations

import time
from typing import Any

import gpytorch
import numpy as np
import torch

from gpcorrect.types import FloatArray
from peers.peer import Peer, Standard, subset

RATE = 0.1
STEPS = 100


class Model(gpytorch.models.ExactGP):
    """Constant mean and ARD kernel; with inducing points SGPR, which learns where they lie."""

    def __init__(self, X: Any, y: Any, likelihood: Any, inducing: Any) -> None:
        super().__init__(X, y, likelihood)
        kernel = gpytorch.kernels.ScaleKernel(gpytorch.kernels.RBFKernel(ard_num_dims=X.shape[1]))
        kernel.base_kernel.lengthscale = 3.0
        self.mean_module = gpytorch.means.ConstantMean()
        self.covar_module = (
            kernel if inducing is None else gpytorch.kernels.InducingPointKernel(kernel, inducing, likelihood)
        )

    def forward(self, x: Any) -> Any:
        """Prior at inputs."""
        return gpytorch.distributions.MultivariateNormal(self.mean_module(x), self.covar_module(x))


class Models:
    """A fitted model for each output; predictions use the library's caches (`fast_pred_var`)."""

    def __init__(self, models: list[Model], standard: Standard) -> None:
        self.models, self.standard = models, standard

    def predict(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return means and standard deviations."""
        inputs = torch.from_numpy(np.array(X))
        means, stds = [], []
        with torch.no_grad(), gpytorch.settings.fast_pred_var():
            for model in self.models:
                answer = model.likelihood(model(inputs))
                means.append(answer.mean.numpy())
                stds.append(answer.stddev.numpy())
        return self.standard.restored(np.column_stack(means), np.column_stack(stds))


def exact(X: FloatArray, Y: FloatArray, limit: float, *, size: int) -> tuple[Peer, str]:
    """Fit to a random subset."""
    rows = subset(X, size)
    return _fit(X[rows], Y[rows], limit, None)


def sgpr(X: FloatArray, Y: FloatArray, limit: float, *, inducing: int) -> tuple[Peer, str]:
    """Fit to all samples through inducing points that start at random samples."""
    return _fit(X, Y, limit, X[subset(X, inducing)])


def _fit(X: FloatArray, Y: FloatArray, limit: float, inducing: FloatArray | None) -> tuple[Peer, str]:
    torch.set_default_dtype(torch.float64)
    torch.set_num_threads(1)
    standard = Standard(Y)
    inputs, steps, models = torch.from_numpy(np.array(X)), [], []
    for y in standard.scaled(Y).T:
        likelihood = gpytorch.likelihoods.GaussianLikelihood()
        points = None if inducing is None else torch.from_numpy(np.array(inducing))
        model = Model(inputs, torch.from_numpy(np.array(y)), likelihood, points)
        steps.append(_train(model, limit / Y.shape[1]))
        models.append(model.eval())
    return Models(models, standard), f"{min(steps)} to {max(steps)} of {STEPS} steps an output"


def _train(model: Model, limit: float) -> int:
    """Take steps until they are done or the time is up; return how many."""
    objective = gpytorch.mlls.ExactMarginalLogLikelihood(model.likelihood, model.train())
    optimiser, start = torch.optim.Adam(model.parameters(), lr=RATE), time.process_time()
    for step in range(STEPS):
        if time.process_time() - start > limit:
            return step
        optimiser.zero_grad()
        loss = -objective(model(*model.train_inputs), model.train_targets)
        loss.backward()
        optimiser.step()
    return STEPS
