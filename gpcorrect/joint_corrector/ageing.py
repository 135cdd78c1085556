"""How large a joint model's errors are beside its own standard deviations, piece after piece of a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.joint import JointData
from gpcorrect.types import FloatArray, IntArray

if TYPE_CHECKING:
    from gpcorrect.joint_corrector.corrector import JointCorrector

__all__ = ["piece_scores"]

PIECE_SECONDS = 20.0
FEWEST = 5  # samples of a piece that can be judged


def piece_scores(corrector: JointCorrector, data: JointData, rows: IntArray) -> FloatArray:
    """Return a score for each piece of 20 s: root mean square of error over standard deviation, about 1 while it holds.

    Joint recordings are often one long motion, so pieces stand where poses have trajectories.

    Raises
    ------
    DataError
        No piece can be judged: truth or input is missing.
    """
    estimate = corrector.estimate(data)
    assert data.truth is not None
    ratio = np.full(data.q.shape, np.nan)
    ratio[rows] = (data.truth[rows] - estimate.q[rows]) / estimate.std[rows]
    squares = np.mean(ratio**2, axis=1)
    labels = _pieces(data)
    scores = []
    for label in np.unique(labels):
        known = squares[(labels == label) & np.isfinite(squares)]
        if known.size >= FEWEST:
            scores.append(float(np.sqrt(known.mean())))
    if not scores:
        raise DataError(
            "no piece of the recording has joints with their truth: nothing can be said of the model's age."
        )
    return np.array(scores)


def _pieces(data: JointData) -> IntArray:
    """Return the number of the piece of each sample: trajectories, cut where they are longer."""
    begins = np.diff(data.trajectory, prepend=data.trajectory[:1] - 1) != 0
    first = np.maximum.accumulate(np.where(begins, np.arange(len(data)), 0))
    inside = ((data.time - data.time[first]) // PIECE_SECONDS).astype(np.int64)
    labels: IntArray = np.cumsum(begins | (np.diff(inside, prepend=0) != 0))
    return labels
