"""What the regression sees of a pose and its velocity: numbers without wrap-around faults, each of unit spread."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.gpr.rotation_features import RotationKind, choose_rotation_kind, rotation_features
from gpcorrect.types import BoolArray, FloatArray, frozen_array

__all__ = ["KINDS", "FeatureMap"]

KINDS = ("pose", "euler", "velocity")
SPREAD_QUANTILES = (16, 84)  # two standard deviations apart in normal data, and blind to a few outliers
# Least spread a feature is divided by: less is jitter of a motion that held it still, not to be blown up to unit size.
LEAST_LINEAR = 1e-4  # m and m/s
LEAST_ANGULAR = 1e-3  # rad, rad/s, and entries of a rotation matrix


@dataclass(frozen=True, eq=False)
class FeatureMap:
    """From positions, rotations and twists to the inputs of the regression (Mahler et al. 2014, Sec. IV-C).

    Parameters
    ----------
    kinds : sequence of str
        "pose": position and rotation, the latter as in :mod:`gpcorrect.gpr.rotation_features`; or "euler": position
        and the paper's angles about fixed axes, which jump at +-180 degrees. And "velocity": the twist. Data without
        rotations give the linear parts only.
    rotation : str
        Representation of rotations, found by :meth:`fit`: "rotvec", "columns" or "euler", "none" for data without
        rotations.
    R_mean : (3, 3) array
        Mean training rotation, found by :meth:`fit`.
    spread : (d,) array
        What each feature is divided by, found by :meth:`fit`; empty before.

    Raises
    ------
    DataError
        Unknown kinds, or not exactly one of "pose" and "euler".
    """

    kinds: Sequence[str]
    rotation: RotationKind = "none"
    R_mean: FloatArray = field(default_factory=lambda: np.eye(3))
    spread: FloatArray = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        unknown = [kind for kind in self.kinds if kind not in KINDS]
        if unknown or ("pose" in self.kinds) == ("euler" in self.kinds):
            raise DataError(
                f"features are pose or euler, with or without velocity; got {', '.join(self.kinds) or 'none'}.",
                hint="For example: --features pose,velocity",
            )
        object.__setattr__(self, "kinds", tuple(self.kinds))
        object.__setattr__(self, "R_mean", frozen_array(self.R_mean))
        object.__setattr__(self, "spread", frozen_array(self.spread))

    @property
    def uses_velocity(self) -> bool:
        """Whether the twist is among the features."""
        return "velocity" in self.kinds

    @property
    def has_orientation(self) -> bool:
        """Whether orientations are among the features (not in a position-only model)."""
        return self.rotation != "none"

    @property
    def n_features(self) -> int:
        """Number of features d."""
        return sum(map(len, self.groups))

    @property
    def groups(self) -> tuple[tuple[int, ...], ...]:
        """Columns that belong together: those of the pose, then those of the velocity; for the kernel's components."""
        pose = 3 + {"none": 0, "columns": 6}.get(self.rotation, 3)
        velocity = (6 if self.has_orientation else 3) if self.uses_velocity else 0
        groups = (tuple(range(pose)), tuple(range(pose, pose + velocity)))
        return tuple(group for group in groups if group)

    def fit(self, positions: FloatArray, rotations: FloatArray | None, twists: FloatArray | None) -> Self:
        """Return a map that knows the representation of rotations and the spread of every feature.

        Parameters
        ----------
        positions : (n, 3) array
            Metres.
        rotations : (n, 3, 3) array or None
            None for data without rotations.
        twists : (n, 6) array or None
            m/s and rad/s; the angular part is not looked at without rotations; None when velocity is not a feature.

        Raises
        ------
        DataError
            Fewer than two samples are complete, or velocity is a feature and there are no twists.
        """
        if self.uses_velocity and twists is None:
            raise DataError(
                "velocity is among the features, but there are no twists.", hint="Give twists, or features pose."
            )
        known = self
        if rotations is not None:
            finite = rotations[np.isfinite(rotations).all(axis=(1, 2))]
            R_mean = se3.rotation_mean(finite)
            kind: RotationKind = "euler" if "euler" in self.kinds else choose_rotation_kind(finite, R_mean)
            known = replace(self, rotation=kind, R_mean=R_mean)
        raw = known._raw(positions, rotations, twists)
        raw = raw[known.usable(raw)]
        if len(raw) < 2:
            raise DataError(
                f"features need at least two complete samples, got {len(raw)}.",
                hint="Look for gaps in the recording.",
            )
        low, high = np.percentile(raw, SPREAD_QUANTILES, axis=0)
        return replace(known, spread=np.maximum((high - low) / 2, known._least_spread()))

    def transform(
        self, positions: FloatArray, rotations: FloatArray | None, twists: FloatArray | None = None
    ) -> FloatArray:
        """Return features `(n, d)`, NaN in rows that are not :meth:`usable`; without twists the poses are at rest."""
        features: FloatArray = self._raw(positions, rotations, twists) / self.spread
        return features

    @staticmethod
    def usable(features: FloatArray) -> BoolArray:
        """Mask `(n,)` of rows with every number present: a run of one sample has no velocity."""
        mask: BoolArray = np.asarray(np.isfinite(features).all(axis=1))
        return mask

    def _raw(self, positions: FloatArray, rotations: FloatArray | None, twists: FloatArray | None) -> FloatArray:
        parts = [positions]
        if rotations is not None and self.rotation != "none":
            parts.append(rotation_features(rotations, self.rotation, self.R_mean))
        if self.uses_velocity:
            twists = np.zeros((len(positions), 6)) if twists is None else twists
            parts.append(twists[:, : 6 if self.has_orientation else 3])
        return np.concatenate(parts, axis=1)

    def _least_spread(self) -> FloatArray:
        linear, angular = np.full(3, LEAST_LINEAR), np.full(3, LEAST_ANGULAR)
        turn = np.full(6 if self.rotation == "columns" else 3, LEAST_ANGULAR)
        parts = [linear]
        parts += [turn] if self.has_orientation else []
        parts += [linear] if self.uses_velocity else []
        parts += [angular] if self.uses_velocity and self.has_orientation else []
        return np.concatenate(parts)

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
        """Rebuild a fitted map from :meth:`to_dict`.

        Raises
        ------
        DataError
            The dictionary does not describe a fitted map.
        """
        features = cls(data["kinds"], data["rotation"], np.array(data["R_mean"]), np.array(data["spread"]))
        if features.R_mean.shape != (3, 3) or features.spread.shape != (features.n_features,):
            raise DataError(
                f"a feature map of {features.n_features} features was expected, got {features.spread.shape}."
            )
        return features
