"""The operator's bound on a learned correction: commands are brought back to it, and the answer says so."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, FloatArray

__all__ = ["CorrectionBound"]

POSE = 7  # numbers of a pose: position and quaternion


@dataclass(frozen=True)
class CorrectionBound:
    """The largest learned correction that may leave a server: command against the registration's reference pose.

    Parameters
    ----------
    position : float
        m; infinite for none.
    rotation : float
        rad; infinite for none.
    """

    position: float = np.inf
    rotation: float = np.inf

    def __post_init__(self) -> None:
        if not (self.position > 0 and self.rotation > 0):
            raise DataError(f"bounds of a correction are above zero, got {self.position} m and {self.rotation} rad.")

    @property
    def acts(self) -> bool:
        """Whether anything is bounded at all."""
        return bool(np.isfinite(self.position) or np.isfinite(self.rotation))

    def apply(self, reference: FloatArray, command: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Shorten the way from a reference to its command: a straight line, and a turn about one axis.

        Parameters
        ----------
        reference, command : (n, 7) or (n, 3) arrays

        Returns
        -------
        bounded : array
            Commands no further from their references than the bounds.
        cut : (n,) bool array
            Which were shortened.
        """
        shift, short = _shortened(command[:, :3] - reference[:, :3], self.position)
        position = np.where(short[:, None], reference[:, :3] + shift, command[:, :3])
        bounded = np.hstack([position, command[:, 3:]])
        if command.shape[1] == POSE:
            R_reference = se3.matrix_from_quaternion(reference[:, 3:])
            R_turn = se3.matrix_from_quaternion(command[:, 3:]) @ R_reference.transpose(0, 2, 1)
            turn, short_turn = _shortened(se3.rotvec_from_matrix(R_turn), self.rotation)
            within = se3.quaternion_from_matrix(se3.matrix_from_rotvec(turn) @ R_reference)
            bounded[:, 3:] = np.where(short_turn[:, None], within, command[:, 3:])
            short = short | short_turn
        return bounded, short


def _shortened(vectors: FloatArray, bound: float) -> tuple[FloatArray, BoolArray]:
    size = np.linalg.norm(vectors, axis=1)
    scale = np.minimum(1.0, bound / np.maximum(size, 1e-300))
    return vectors * scale[:, None], scale < 1.0
