"""The tracker beside the simulator: simulated marker poses in the tracker's frame, as positions and small turns."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gpcorrect import se3
from gpcorrect.discrepancy.settings import NOISE
from gpcorrect.types import BoolArray, FloatArray, PoseSignal


@dataclass(frozen=True, eq=False)
class Tracker:
    """What a tracker measured, and what the model leaves open of its frames.

    Parameters
    ----------
    position : (n, 3) array
        Measured, m; NaN is missing.
    rotation : (n, 3, 3) array or None
        Measured orientations; NaN is missing, None where only positions are compared.
    rows : (n,) bool array
        On which an open frame is registered.
    base_known, marker_known : bool
        Whether the model states where the base stands in the tracker's frame, and how the marker sits on the tip.
    reference : (n, 3, 3) array or None
        Orientations from which measured and simulated turns are written down: the nominal model's, so that turns stay
        small.
    """

    position: FloatArray
    rotation: FloatArray | None
    rows: BoolArray
    base_known: bool
    marker_known: bool
    reference: FloatArray | None = None

    @classmethod
    def of(cls, signal: PoseSignal, rows: BoolArray, *, base_known: bool, marker_known: bool) -> Tracker:
        """Return the tracker of a recording's signal, positions only until it is :meth:`about` a reference."""
        rotation = None if signal.quaternion is None else se3.matrix_from_quaternion(signal.quaternion)
        return cls(signal.position, rotation, rows, base_known, marker_known)

    def about(self, T: FloatArray) -> tuple[Tracker, str]:
        """Return the tracker with orientations compared about simulated ones, and why not, where they cannot be.

        Parameters
        ----------
        T : (n, 4, 4) array
            Marker poses of the nominal model.
        """
        if self.rotation is None:
            return self, "the tracker's log holds no orientations: positions alone are compared"
        about = replace(self, reference=self._placed(T)[1])
        assert about.reference is not None
        seen = self.rows & np.isfinite(self.rotation[:, 0, 0])
        if not seen.any():
            return replace(self, rotation=None), "the tracker's orientations are missing: positions alone are compared"
        angle = float(np.sqrt(np.mean(se3.angle(about.reference[seen].swapaxes(1, 2) @ self.rotation[seen]) ** 2)))
        if angle > NOISE.most_turned:
            words = f"the tracker's orientations do not follow the arm's ({np.degrees(angle):.0f} degrees RMS between)"
            return replace(self, rotation=None), f"{words}: positions alone are compared"
        return about, ""

    @cached_property
    def observed(self) -> FloatArray:
        """Measured `(n, 3)` positions, with `(n, 3)` rotation vectors behind them where orientations are compared."""
        if self.rotation is None or self.reference is None:
            return self.position
        return np.concatenate([self.position, self._turns(self.rotation)], axis=1)

    def predicted(self, T: FloatArray) -> FloatArray:
        """Return what the tracker should say, of the same shape as what was observed.

        Parameters
        ----------
        T : (n, 4, 4) array
            Simulated marker poses, in the tracker's frame as far as the model knows it.
        """
        if self.rotation is None or self.reference is None:
            return self._position(T)[0]
        position, rotation = self._placed(T)
        return np.concatenate([position, self._turns(rotation)], axis=1)

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

    def _placed(self, T: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions and orientations in the tracker's frame, the marker turned on the tip as it fits best."""
        position, turn = self._position(T)
        rotation: FloatArray = turn @ T[:, :3, :3]
        if not self.marker_known:
            assert self.rotation is not None
            seen = self.rows & np.isfinite(self.rotation[:, 0, 0])
            if seen.any():
                rotation = rotation @ se3.nearest_rotation(
                    np.mean(rotation[seen].swapaxes(1, 2) @ self.rotation[seen], axis=0)
                )
        return position, rotation

    def _turns(self, rotation: FloatArray) -> FloatArray:
        """Rotation vectors `(n, 3)`, tracker's frame, from the reference to these orientations; NaN stays."""
        assert self.reference is not None
        return se3.rotvec_from_matrix(rotation @ self.reference.swapaxes(1, 2))
