"""Model files of joint calibrations: the same archive, digests and check queries as those of poses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gpcorrect.artifact import read_parts, refused, write_parts
from gpcorrect.errors import ArtifactError
from gpcorrect.joint import JointData
from gpcorrect.joint_corrector import JointCorrector
from gpcorrect.types import FloatArray

__all__ = ["JOINT_KIND", "is_joint_model", "load_joint", "save_joint"]

JOINT_KIND = "gpcorrect.joint_corrector"
CHECK_TOLERANCE = 1e-9  # rad and m
CHECK_SAMPLES = 12


def save_joint(corrector: JointCorrector, path: str | Path) -> None:
    """Write the model file atomically.

    Raises
    ------
    GpCorrectError
        The folder cannot be written.
    """
    model, arrays = corrector.to_parts()
    write_parts(path, JOINT_KIND, {"model": model, "check": _answers(corrector)}, arrays)


def load_joint(path: str | Path) -> JointCorrector:
    """Read a model file, verify it, and ask it its recorded check path.

    Raises
    ------
    ArtifactError
        The file is missing, truncated, altered, of a newer schema, of another kind, or answers otherwise than when it
        was saved.
    """
    header, arrays = read_parts(path, JOINT_KIND)
    try:
        corrector = JointCorrector.from_parts(header["model"], arrays)
        given = np.array(_answers(corrector))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise refused(path, f"its contents do not form a model ({error})") from error
    expected = np.array(header.get("check"))
    if expected.shape != given.shape or not np.allclose(expected, given, rtol=0, atol=CHECK_TOLERANCE):
        raise refused(path, "it answers its own check queries otherwise than when it was saved")
    return corrector


def is_joint_model(path: str | Path) -> bool:
    """Whether the file is a whole model of joints; whatever else is wrong with it, loading it will say."""
    try:
        read_parts(path, JOINT_KIND)
    except ArtifactError:
        return False
    return True


def _answers(corrector: JointCorrector) -> list[list[float]]:
    """Estimates along a short swing through the middle of the training range."""
    features = corrector.features
    swing = np.sin(np.linspace(0.0, 2.0 * np.pi, CHECK_SAMPLES))[:, None] * features.half
    answer = corrector.estimate(_path(features.centre + swing, features.n_state, corrector.types))
    numbers: list[list[float]] = np.nan_to_num(np.hstack([answer.q, answer.std])).tolist()
    return numbers


def _path(q: FloatArray, n_state: int, types: str) -> JointData:
    n = len(q)
    at_rest: Any = np.zeros(q.shape)
    return JointData(
        time=np.arange(n, dtype=np.float64),
        trajectory=np.zeros(n, dtype=np.int64),
        session=np.zeros(n, dtype=np.int64),
        new=np.arange(n) == 0,
        q=q,
        truth=None,
        velocity=at_rest,
        effort=at_rest,
        state=np.zeros((n, n_state)) if n_state else None,
        types=types,
    )
