"""The rigid model that the majority of the samples agrees on."""

from __future__ import annotations

import numpy as np

from gpcorrect.cleaning.lmeds import LeastMedianFit, least_median
from gpcorrect.cleaning.samples import Register, RigidMap, part_norms, pose_error
from gpcorrect.types import FloatArray, PoseSignal

__all__ = ["fit_rigid_robustly"]

SAMPLE_SIZE = 4  # one more than positions need: orientations and a marker offset are then determined too
MOST_SAMPLES = 1000  # neighbours in time say the same twice


def fit_rigid_robustly(
    observed: PoseSignal, command: PoseSignal, register: Register, resolution: FloatArray, rng: np.random.Generator
) -> LeastMedianFit[RigidMap]:
    """Registration by least median of squares around the rigid model (Mahler 2014, Sec. IV-A).

    Position and rotation have a scale each.

    Parameters
    ----------
    observed, command : PoseSignal
        n complete samples.
    register : callable
        Least-squares registration of any number of samples.
    resolution : (2,) array
        Smallest scales, m and rad.
    rng : numpy Generator
        Source of the random samples.

    Raises
    ------
    DataError
        Fewer than four samples.
    DegenerateError
        No random sample determines a registration.
    """
    rows = np.unique(np.linspace(0, len(observed) - 1, min(len(observed), MOST_SAMPLES)).round().astype(np.int64))
    observed, command = observed[rows], command[rows]
    return least_median(
        lambda few: register(observed[few], command[few]),
        lambda rigid: part_norms(pose_error(rigid.apply(observed), command)),
        len(rows),
        sample_size=SAMPLE_SIZE,
        rng=rng,
        dimension=3,
        floor=float(resolution.min()),
    )
