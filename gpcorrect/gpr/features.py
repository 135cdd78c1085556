"""What the regression sees of a pose and its velocity: numbers without wrap-around faults, each of unit spread."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import atan2, sqrt
from typing import Any, Self

import numpy as np

from gpcorrect import se3, se3_single
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray, frozen_array

__all__ = ["KINDS", "FeatureMap"]

KINDS = ("pose", "euler", "velocity")
WIDEST_ROTVEC = np.deg2rad(120.0)  # beyond it a rotation vector comes too near its jump at 180 degrees
SPREAD_QUANTILES = (16, 84)  # two standard deviations apart in normal data, and blind to a few outliers


class FeatureMap:
    """From positions, rotations and twists to the inputs of the regression (Mahler 2014, Sec. IV-C).

    "pose" is the position and the rotation: the rotation vector relative to the training's mean orientation where all of the training
    lies within 120 degrees of it, else two columns of the rotation matrix, which have no jump anywhere. "euler" is the
    paper's variant: the position and fixed-axes x-y-z angles, which jump at 180 degrees. "velocity" adds the twist.

    Parameters
    ----------
    kinds : sequence of str
        "pose" or "euler", and "velocity" or not.

    Raises
    ------
    DataError
        Unknown kinds, or not exactly one of "pose" and "euler".
    """

    def __init__(self, kinds: Sequence[str]) -> None:
        unknown = [kind for kind in kinds if kind not in KINDS]
        if unknown or ("pose" in kinds) == ("euler" in kinds):
            raise DataError(
                f"features are pose or euler, with or without velocity; got {', '.join(kinds) or 'none'}.",
                hint="For example: --features pose,velocity",
            )
        self.kinds = tuple(kinds)
        self.rotation = "none"
        self.R_mean = frozen_array(np.eye(3))
        self.spread = frozen_array(np.ones(0))

    @property
    def uses_velocity(self) -> bool:
        """Whether the twist is among the features."""
        return "velocity" in self.kinds

    @property
    def has_orientation(self) -> bool:
        """Whether orientations are among the features (not in a position-only model)."""
        return self.rotation != "none"

    def fit(self, positions: FloatArray, rotations: FloatArray | None, twists: FloatArray) -> Self:
        """Learn the representation of rotations and the spread of every feature.

        Parameters
        ----------
        positions : (n, 3) array
            Metres.
        rotations : (n, 3, 3) array or None
            None for positions only.
        twists : (n, 6) array
            m/s and rad/s; the angular part is not looked at for positions only.
        """
        if rotations is not None:
            self.R_mean = frozen_array(se3.rotation_mean(rotations))
            widest = se3.angle(rotations @ self.R_mean.T).max()
            self.rotation = "euler" if "euler" in self.kinds else "rotvec" if widest <= WIDEST_ROTVEC else "columns"
        low, high = np.percentile(self._raw(positions, rotations, twists), SPREAD_QUANTILES, axis=0)
        self.spread = frozen_array(np.where(high - low > 1e-12, (high - low) / 2, 1.0))
        return self

    def transform(self, positions: FloatArray, rotations: FloatArray | None, twists: FloatArray) -> FloatArray:
        """Return the features `(n, d)` of poses and twists, as given to :meth:`fit`."""
        return self._raw(positions, rotations, twists) / self.spread

    def transform_one(self, position: FloatArray, rotation: FloatArray | None, twist: FloatArray) -> FloatArray:
        """Return the features `(d,)` of one position `(3,)`, rotation `(3, 3)` or None, and twist `(6,)`: the hot path."""
        parts = [position]
        if rotation is not None and self.has_orientation:
            parts.append(self._turn_one(rotation))
        if self.uses_velocity:
            parts.append(twist if self.has_orientation else twist[:3])
        return np.concatenate(parts) / self.spread

    def _raw(self, positions: FloatArray, rotations: FloatArray | None, twists: FloatArray) -> FloatArray:
        parts = [positions]
        if rotations is not None and self.has_orientation:
            parts.append(self._turns(rotations))
        if self.uses_velocity:
            parts.append(twists if self.has_orientation else twists[:, :3])
        return np.concatenate(parts, axis=1)

    def _turns(self, rotations: FloatArray) -> FloatArray:
        if self.rotation == "columns":
            return np.concatenate([rotations[:, :, 0], rotations[:, :, 1]], axis=1)
        if self.rotation == "euler":
            return np.array([_fixed_axes_angles(R) for R in rotations])
        return se3.rotvec_from_matrix(rotations @ self.R_mean.T)

    def _turn_one(self, rotation: FloatArray) -> FloatArray:
        if self.rotation == "columns":
            return rotation[:, :2].T.ravel()
        if self.rotation == "euler":
            return _fixed_axes_angles(rotation)
        return se3_single.rotvec_from_matrix(rotation @ self.R_mean.T)

    def to_dict(self) -> dict[str, Any]:
        """Return what was learned as lists and text."""
        return {
            "kinds": list(self.kinds),
            "rotation": self.rotation,
            "R_mean": self.R_mean.tolist(),
            "spread": self.spread.tolist(),
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Rebuild a fitted map from :meth:`to_dict`."""
        features = cls(data["kinds"])
        features.rotation = data["rotation"]
        features.R_mean = frozen_array(data["R_mean"])
        features.spread = frozen_array(data["spread"])
        return features


def _fixed_axes_angles(rotation: FloatArray) -> FloatArray:
    """Angles `(3,)` about the fixed axes x, y and z, in this order, rad: R = Rz Ry Rx."""
    (a, _, _), (d, _, _), (g, h, i) = rotation.tolist()
    return np.array([atan2(h, i), atan2(-g, sqrt(a * a + d * d)), atan2(d, a)])
