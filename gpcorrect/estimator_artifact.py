"""Model files of position estimators: the same archive, digests and check queries as those of poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gpcorrect.artifact import read_parts, refused, write_parts
from gpcorrect.errors import DataError
from gpcorrect.estimator import EstimatorData, PositionEstimator

__all__ = ["ESTIMATOR_KIND", "load_estimator", "save_estimator"]

ESTIMATOR_KIND = "gpcorrect.position_estimator"
CHECK_TOLERANCE = 1e-9  # m
CHECK_SAMPLES = 8


def save_estimator(estimator: PositionEstimator, path: str | Path) -> None:
    """Write the model file atomically.

    Raises
    ------
    GpCorrectError
        The folder cannot be written.
    """
    model, arrays = estimator.to_parts()
    write_parts(path, ESTIMATOR_KIND, {"model": model, "check": _answers(estimator)}, arrays)


def load_estimator(path: str | Path) -> PositionEstimator:
    """Read a model file, verify it, and ask it its recorded check path.

    Raises
    ------
    ArtifactError
        The file is missing, truncated, altered, of another kind, or answers otherwise than when it was saved.
    """
    header, arrays = read_parts(path, ESTIMATOR_KIND)
    try:
        estimator = PositionEstimator.from_parts(header["model"], arrays)
        given = np.array(_answers(estimator))
    except (KeyError, TypeError, ValueError, AttributeError, DataError) as error:
        raise refused(path, f"its contents do not form a model ({error})") from error
    expected = np.array(header.get("check"))
    if expected.shape != given.shape or not np.allclose(expected, given, rtol=0, atol=CHECK_TOLERANCE):
        raise refused(path, "it answers its own check queries otherwise than when it was saved")
    return estimator


def _answers(estimator: PositionEstimator) -> list[list[float]]:
    """Estimates along a short swing through the middle of the training range, everything else at zero."""
    n, dof = CHECK_SAMPLES, len(estimator.centre)
    q = estimator.centre + np.sin(np.linspace(0.0, 2.0 * np.pi, n))[:, None] * estimator.half
    data = EstimatorData(
        np.arange(n, dtype=np.float64),
        np.zeros(n, dtype=np.int64),
        np.arange(n) == 0,
        q,
        np.zeros((n, len(estimator.state_names))),
        np.zeros((n, dof)),
        np.zeros((n, 3)),
        None,
    )
    answer = estimator.estimate(data)
    numbers: list[list[float]] = np.nan_to_num(np.hstack([answer.position, answer.std])).tolist()
    return numbers
