"""The tracker beside the simulator: simulated marker poses in the tracker's frame, as positions and small turns."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gpcorrect import se3
from gpcorrect.discrepancy.settings import NOISE
from gpcorrect.types import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Tracker:
    """Measured positions `(n, 3)`, m (NaN is missing), and what the model leaves open of the tracker's frames.

    An open frame, of the base in the tracker's or of the marker on the tip, is registered on `rows` `(n,)`. `rotation`
    `(n, 3, 3)` are measured orientations, and `reference` the nominal model's, from which measured and simulated turns
    are written down, so that these stay small; both are None where only positions are compared.
    """

    position: FloatArray
    rows: BoolArray
    base_known: bool
    marker_known: bool
    rotation: FloatArray | None = None
    reference: FloatArray | None = None

    def with_orientations(self, quaternion: FloatArray | None, T: FloatArray) -> tuple[Tracker, str]:
        """Return the tracker with orientations compared about simulated ones, and why not, where they cannot be.

        Parameters
        ----------
        quaternion : (n, 4) array or None
            Measured, wxyz.
        T : (n, 4, 4) array
            Marker poses of the nominal model.
        """
        if quaternion is None:
            return self, "the tracker's log holds no orientations: positions alone are compared"
        rotation = se3.matrix_from_quaternion(quaternion)
        seen = self.rows & np.isfinite(rotation[:, 0, 0])
        if not seen.any():
            return self, "the tracker's orientations are missing: positions alone are compared"
        _, reference = self._placed(T, rotation)
        angle = float(np.sqrt(np.mean(se3.angle(reference[seen].swapaxes(1, 2) @ rotation[seen]) ** 2)))
        if angle > NOISE.most_turned:
            words = f"the tracker's orientations do not follow the arm's ({np.degrees(angle):.0f} degrees RMS between)"
            return self, f"{words}: positions alone are compared"
        return replace(self, rotation=rotation, reference=reference), ""

    @cached_property
    def observed(self) -> FloatArray:
        """Measured `(n, 3)` positions, with `(n, 3)` rotation vectors behind them where orientations are compared."""
        return self.position if self.rotation is None else self._with_turns(self.position, self.rotation)

    def predicted(self, T: FloatArray) -> FloatArray:
        """Return what the tracker should say, of the same shape as what was observed.

        Parameters
        ----------
        T : (n, 4, 4) array
            Simulated marker poses, in the tracker's frame as far as the model knows it.
        """
        if self.rotation is None:
            return self._position(T)[0]
        return self._with_turns(*self._placed(T, self.rotation))

    def _position(self, T: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions moved rigidly onto the tracker's where its frame is open (Arun 1987), and by which rotation."""
        position = T[:, :3, 3]
        if self.base_known:
            return position, np.eye(3)
        rows = self.rows & np.isfinite(self.position).all(axis=1) & np.isfinite(position).all(axis=1)
        a, b = position[rows], self.position[rows]
        middle, centre = a.mean(axis=0), b.mean(axis=0)
        turn = se3.nearest_rotation((b - centre).T @ (a - middle))
        moved: FloatArray = (position - middle) @ turn.T + centre
        return moved, turn

    def _placed(self, T: FloatArray, measured: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions and orientations in the tracker's frame, the marker turned on the tip as it fits best."""
        position, turn = self._position(T)
        # One product of large matrices each, several times as fast as one of small ones a row.
        rotation = np.ascontiguousarray(np.tensordot(T[:, :3, :3], turn, axes=(1, 1)).swapaxes(1, 2))
        if not self.marker_known:
            seen = self.rows & np.isfinite(measured[:, 0, 0])
            between = rotation[seen].reshape(-1, 3).T @ measured[seen].reshape(-1, 3)
            rotation = (rotation.reshape(-1, 3) @ se3.nearest_rotation(between)).reshape(-1, 3, 3)
        return position, rotation

    def _with_turns(self, position: FloatArray, rotation: FloatArray) -> FloatArray:
        """Positions, and rotation vectors (tracker's frame) from the reference to these orientations; NaN stays."""
        assert self.reference is not None
        turns = se3.rotvec_from_matrix(rotation @ self.reference.swapaxes(1, 2))
        return np.concatenate([position, turns], axis=1)
