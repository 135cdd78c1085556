"""A temporal convolutional network: causal convolutions of kernel 2 whose dilations double, in plain numpy.

Of the answer at one sample only a binary tree of each layer's outputs is needed (of the first every second, of the next
every fourth, ...), so that a layer is a product of a matrix with pairs of its neighbours (van den Oord et al. 2016,
Sec. 2.1; Bai, Kolter and Koltun 2018, Sec. 3).
"""

from __future__ import annotations

import numpy as np

from gpcorrect.types import FloatArray

LAYERS = 5
PAST = 2**LAYERS
"""Samples that an answer depends on, its own among them."""


class TemporalNetwork:
    """Five layers of rectified units and a linear one; Adam, stopped where the last tenth of the samples is worse.

    Parameters
    ----------
    channels : int, units of a layer
    epochs, patience : int, most passes over the data, and those without a better one after which it stops
    batch : int, samples a step
    rate : float, of Adam
    seed : int, of the first weights and of the order of samples
    """

    def __init__(
        self,
        channels: int = 32,
        epochs: int = 150,
        patience: int = 15,
        batch: int = 128,
        rate: float = 1e-3,
        seed: int = 0,
    ) -> None:
        self.channels, self.epochs, self.patience = channels, epochs, patience
        self.batch, self.rate, self.seed = batch, rate, seed

    def fit(self, X: FloatArray, Y: FloatArray) -> TemporalNetwork:
        """Learn targets `(n, m)` from `(n, 32 d)`: the signals of each sample and of the 31 before, oldest first."""
        rng = np.random.default_rng(self.seed)
        signals = X.reshape(len(X), PAST, -1)
        self._centre, self._spread = signals.mean(axis=(0, 1)), np.maximum(signals.std(axis=(0, 1)), 1e-12)
        self._mean, self._scale = Y.mean(axis=0), np.maximum(Y.std(axis=0), 1e-12)
        sizes = [2 * signals.shape[2], *LAYERS * [2 * self.channels]]
        sizes[-1] = self.channels
        outs = [*LAYERS * [self.channels], Y.shape[1]]
        weights = [rng.normal(0.0, np.sqrt(2.0 / k), (k, m)) for k, m in zip(sizes, outs, strict=True)]
        p = [*weights, *(np.zeros(m) for m in outs)]
        inputs, targets = (signals - self._centre) / self._spread, (Y - self._mean) / self._scale
        inner = len(X) - len(X) // 10
        moments = [(np.zeros_like(a), np.zeros_like(a)) for a in p]
        best, self._parameters, step, since = np.inf, [a.copy() for a in p], 0, 0
        for _ in range(self.epochs):
            for rows in np.array_split(rng.permutation(inner), max(inner // self.batch, 1)):
                step += 1
                for a, slope, (m, v) in zip(p, _slopes(p, inputs[rows], targets[rows]), moments, strict=True):
                    m += 0.1 * (slope - m)
                    v += 1e-3 * (slope**2 - v)
                    a -= self.rate * m / (1 - 0.9**step) / (np.sqrt(v / (1 - 0.999**step)) + 1e-8)
            loss = float(np.mean((_forward(p, inputs[inner:])[-1] - targets[inner:]) ** 2))
            since += 1
            if loss < best:
                best, self._parameters, since = loss, [a.copy() for a in p], 0
            if since > self.patience:
                break
        return self

    def predict(self, X: FloatArray) -> FloatArray:
        """Return targets `(n, m)`."""
        signals = (X.reshape(len(X), PAST, -1) - self._centre) / self._spread
        return self._mean + self._scale * _forward(self._parameters, signals)[-1]


def _forward(p: list[FloatArray], signals: FloatArray) -> list[FloatArray]:
    """Return what goes into each layer, and what comes out of the last."""
    outputs = [signals.reshape(len(signals), PAST // 2, -1)]
    for layer in range(LAYERS):
        out = np.maximum(outputs[-1] @ p[layer] + p[LAYERS + 1 + layer], 0.0)
        outputs.append(out.reshape(len(out), max(out.shape[1] // 2, 1), -1))
    outputs[-1] = outputs[-1].reshape(len(signals), -1)
    return [*outputs, outputs[-1] @ p[LAYERS] + p[-1]]


def _slopes(p: list[FloatArray], signals: FloatArray, targets: FloatArray) -> list[FloatArray]:
    """Return the slopes of half the mean squared error by weights and offsets."""
    *inputs, found = _forward(p, signals)
    back, by_weights, by_offsets = (found - targets) / targets.size, [], []
    for layer in range(LAYERS, -1, -1):
        before = inputs[layer]
        flat, tail = before.reshape(-1, before.shape[-1]), back.reshape(-1, back.shape[-1])
        by_weights.append(flat.T @ tail)
        by_offsets.append(tail.sum(axis=0))
        if layer:
            through = (tail @ p[layer].T).reshape(before.shape)
            back = np.where(before > 0, through, 0.0).reshape(len(signals), -1, len(p[LAYERS + layer]))
    return [*by_weights[::-1], *by_offsets[::-1]]
