"""Held-out errors of rigid models, over whole trajectories."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gpcorrect.errors import DegenerateError
from gpcorrect.rigid.model import RigidKind, RigidModel
from gpcorrect.rigid.residuals import pose_residual
from gpcorrect.rigid.robust import evenly_spaced
from gpcorrect.types import FloatArray, IntArray, PoseSignal

__all__ = ["LEAST_BLOCK", "Fit", "UnitErrors", "held_out_errors", "hold_out_units"]

Fit = Callable[[PoseSignal, PoseSignal], RigidModel]

FOLDS = 5
BLOCKS = 10  # parts of a recording that has too few trajectories to leave some out
LEAST_BLOCK = 3  # samples
MAX_SAMPLES = 1000  # in a fold's fit: enough to rank the kinds
MAX_JUDGED = 200  # in each unit, for its median


@dataclass(frozen=True, eq=False)
class UnitErrors:
    """Held-out errors of one kind of model, one row a unit (a trajectory, or a block of a single one).

    Parameters
    ----------
    kind : str
        Kind of the model.
    position : (m,) array
        Median position error in each unit, m; NaN where the kind was refused.
    rotation : (m,) array
        Median rotation error in each unit, rad; NaN where there are no orientations.
    refused : str
        Why the kind could not be fitted; empty when it could.
    """

    kind: RigidKind
    position: FloatArray
    rotation: FloatArray
    refused: str = ""


def hold_out_units(trajectory: IntArray) -> IntArray:
    """Return the unit `(n,)` of each sample, in recorded order: its trajectory, or its block.

    Samples of one motion repeat each other, so whole trajectories are left out where there are at least as
    many as folds; otherwise the recording is cut into contiguous blocks.
    """
    _, first, label = np.unique(trajectory, return_index=True, return_inverse=True)
    if len(first) >= FOLDS:
        rank: IntArray = np.argsort(np.argsort(first))
        units: IntArray = rank[label.reshape(-1)]
        return units
    n = len(trajectory)
    blocks = max(min(BLOCKS, n // LEAST_BLOCK), 1)
    return np.arange(n) * blocks // max(n, 1)


def held_out_errors(
    kind: RigidKind, fit: Fit, observed: PoseSignal, command: PoseSignal, units: IntArray
) -> UnitErrors:
    """Errors in each unit of the model fitted without its fold, a run of neighbouring units.

    A kind that some fold's data do not determine is refused as a whole.
    """
    n_units = int(units.max()) + 1
    position, rotation = np.full(n_units, np.nan), np.full(n_units, np.nan)
    rows_of = np.split(np.argsort(units, kind="stable"), np.cumsum(np.bincount(units))[:-1])
    folds = min(FOLDS, n_units)
    for fold in range(folds):
        held = units * folds // n_units == fold
        rows = np.flatnonzero(~held)
        rows = rows[evenly_spaced(len(rows), MAX_SAMPLES)]
        try:
            model = fit(observed[rows], command[rows])
        except DegenerateError as error:
            nothing = np.full(n_units, np.nan)
            return UnitErrors(kind, nothing, nothing, refused=error.message)
        for unit in np.unique(units[held]):
            position[unit], rotation[unit] = _median_errors(model, observed, command, rows_of[unit])
    return UnitErrors(kind, position, rotation)


def _median_errors(model: RigidModel, observed: PoseSignal, command: PoseSignal, rows: IntArray) -> tuple[float, float]:
    rows = rows[evenly_spaced(len(rows), MAX_JUDGED)]
    residual = pose_residual(model.apply(observed[rows]), command[rows])
    position, rotation = (np.linalg.norm(part, axis=1) for part in (residual[:, :3], residual[:, 3:]))
    return float(np.median(position)), float(np.median(rotation))
