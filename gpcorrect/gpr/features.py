"""What the regression sees of a pose and its velocity: numbers without wrap-around faults, each of unit spread.

What is near must have near numbers, also across +-180 degrees. No three numbers do that for all rotations. Three do (a
rotation vector measured from the mean) while the data stay well within half a turn of their mean; else six are used:
two columns of the matrix, smooth everywhere. Euler angles are there for comparison with the paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, Self

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray, frozen_array

RotationKind = Literal["none", "rotvec", "columns", "euler"]

KINDS = ("pose", "euler", "velocity")
WIDEST_ROTVEC = float(np.deg2rad(120.0))  # leaves 60 degrees between the training and the jump at 180
SPREAD_QUANTILES = (16, 84)  # two standard deviations apart in normal data, and blind to a few outliers
# What a feature may always lie outside its training range, m, rad, m/s and rad/s.
SLACK, TURN_SLACK, SPEED_SLACK, TURNING_SLACK = 0.005, 0.1, 0.02, 0.2
# Least spread a feature is divided by: less is jitter of a motion that held it still, not to be blown up to unit size.
LEAST_LINEAR = 1e-4  # m and m/s
LEAST_ANGULAR = 1e-3  # rad, rad/s, and entries of a rotation matrix
ORTHONORMAL = 1e-6  # of R R^T - I: far above rounding


@dataclass(frozen=True, eq=False)
class FeatureMap:
    """From positions, rotations and twists to the inputs of the regression (Mahler et al. 2014, Sec. IV-C).

    Parameters
    ----------
    kinds : sequence of str
        "pose": position and rotation, the latter as in the module says; or "euler": position and the paper's angles
        about fixed axes, which jump half a turn from those of the mean training rotation. And "velocity": the twist.
        Data without rotations give the linear parts only.
    rotation : str
        Representation of rotations, found by :meth:`fit`: "rotvec", "columns" or "euler", "none" for data without
        rotations.
    R_mean : (3, 3) array, mean training rotation, found by :meth:`fit`
    spread : (d,) array, what each feature is divided by, found by :meth:`fit`; empty before

    Raises
    ------
    DataError
        Unknown kinds, or not exactly one of "pose" and "euler"; or what :meth:`fit` finds has another shape.
    """

    kinds: Sequence[str]
    rotation: RotationKind = "none"
    R_mean: FloatArray = field(default_factory=lambda: np.eye(3))
    spread: FloatArray = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        unknown = [kind for kind in self.kinds if kind not in KINDS]
        if unknown or ("pose" in self.kinds) == ("euler" in self.kinds):
            raise DataError(
                f"features are pose or euler, then velocity and memory at will; got {', '.join(self.kinds) or 'none'}.",
                hint="For example: --features pose,velocity",
            )
        object.__setattr__(self, "kinds", tuple(self.kinds))
        object.__setattr__(self, "R_mean", frozen_array(self.R_mean))
        object.__setattr__(self, "spread", frozen_array(self.spread))
        if self.R_mean.shape != (3, 3) or self.spread.shape not in ((0,), (self.n_features,)):
            raise DataError(f"a feature map of {self.n_features} features was expected, got {self.spread.shape}.")
        if not (np.abs(self.R_mean @ self.R_mean.T - np.eye(3)).max() < ORTHONORMAL and np.linalg.det(self.R_mean) > 0):
            raise DataError(f"no features are counted from {self.R_mean.tolist()}, which is no rotation.")
        if not (self.spread > 0).all():
            raise DataError(f"no features are spread {self.spread}.")

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
        positions : (n, 3) array, metres
        rotations : (n, 3, 3) array or None, None for data without rotations
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
            kind: RotationKind = "euler"
            if "euler" not in self.kinds:
                kind = "rotvec" if se3.angle(finite @ R_mean.T).max() <= WIDEST_ROTVEC else "columns"
            known = replace(self, rotation=kind, R_mean=R_mean, spread=np.empty(0))
        raw = known._raw(positions, rotations, twists)
        raw = raw[np.isfinite(raw).all(axis=1)]
        if len(raw) < 2:
            raise DataError(
                f"features need at least two complete samples, got {len(raw)}.", hint="Look for gaps in the recording."
            )
        low, high = np.percentile(raw, SPREAD_QUANTILES, axis=0)
        return replace(
            known,
            spread=np.maximum((high - low) / 2, known._each(LEAST_LINEAR, LEAST_ANGULAR, LEAST_LINEAR, LEAST_ANGULAR)),
        )

    def transform(
        self, positions: FloatArray, rotations: FloatArray | None, twists: FloatArray | None = None
    ) -> FloatArray:
        """Return features `(n, d)`, NaN where a number is missing; without twists the poses are at rest.

        Parameters
        ----------
        positions : (n, 3) array, metres
        rotations : (n, 3, 3) array or None, rotation matrices
        twists : (n, 6) array, optional, m/s and rad/s
        """
        return self._raw(positions, rotations, twists) / self.spread

    def inverse(self, features: FloatArray) -> tuple[FloatArray, FloatArray | None, FloatArray | None]:
        """Return positions, rotations and twists that have (or, for columns, come nearest to) features.

        No rotations without orientation, and no twists where velocity is no feature.

        Parameters
        ----------
        features : (n, d) array
        """
        raw = features * self.spread
        pose = len(self.groups[0])
        rotations = _rotations_from_features(raw[:, 3:pose], self.rotation, self.R_mean)
        return raw[:, :3], rotations, raw[:, pose:] if self.uses_velocity else None

    def _raw(self, positions: FloatArray, rotations: FloatArray | None, twists: FloatArray | None) -> FloatArray:
        parts = [positions]
        if rotations is not None and self.rotation != "none":
            parts.append(_rotation_features(rotations, self.rotation, self.R_mean))
        if self.uses_velocity:
            twists = np.zeros((len(positions), 6)) if twists is None else twists
            parts.append(twists[:, : 6 if self.has_orientation else 3])
        return np.concatenate(parts, axis=1)

    @property
    def slack(self) -> FloatArray:
        """How far outside its range (d,) a feature may always be: a motion that held it still is no wall."""
        return self._each(SLACK, TURN_SLACK, SPEED_SLACK, TURNING_SLACK) / self.spread

    def _each(self, linear: float, turn: float, speed: float, turning: float) -> FloatArray:
        """Return a number for every feature `(d,)`, by its kind."""
        parts = [np.full(3, linear), np.full(len(self.groups[0]) - 3, turn)]
        if self.uses_velocity:
            parts += [np.full(3, speed), np.full(len(self.groups[1]) - 3, turning)]
        return np.concatenate(parts)


def _rotation_features(rotations: FloatArray, kind: RotationKind, R_mean: FloatArray) -> FloatArray:
    """Features `(n, 3)` or `(n, 6)` of rotations `(n, 3, 3)`; NaN for a rotation that is not finite."""
    if kind == "columns":
        return np.concatenate([rotations[:, :, 0], rotations[:, :, 1]], axis=1)
    if kind == "euler":
        centre = _fixed_axes_angles(R_mean)  # half a turn from it, far from the training, is where angles jump
        return centre + np.mod(_fixed_axes_angles(rotations) - centre + np.pi, 2 * np.pi) - np.pi
    return se3.rotvec_from_matrix(rotations @ R_mean.T)


def _rotations_from_features(features: FloatArray, kind: RotationKind, R_mean: FloatArray) -> FloatArray | None:
    """Rotations `(n, 3, 3)` of features `(n, 3)` or `(n, 6)`; columns that are not orthonormal are made so."""
    if kind == "none":
        return None
    if kind == "columns":
        x = features[:, :3] / np.linalg.norm(features[:, :3], axis=1, keepdims=True)
        y = features[:, 3:] - (features[:, 3:] * x).sum(axis=1, keepdims=True) * x
        y /= np.linalg.norm(y, axis=1, keepdims=True)
        return np.stack([x, y, np.cross(x, y)], axis=2)
    if kind == "euler":
        axes = np.eye(3)
        Rx, Ry, Rz = (se3.matrix_from_rotvec(features[:, [i]] * axes[i]) for i in range(3))
        return Rz @ Ry @ Rx
    return se3.matrix_from_rotvec(features) @ R_mean


def _fixed_axes_angles(rotations: FloatArray) -> FloatArray:
    """Angles `(..., 3)` about the fixed axes x, y and z in this order, rad: `R = Rz Ry Rx` (the paper's Euler angles).

    They jump by a full turn at +-180 degrees, and x and z are not defined apart where y reaches +-90 degrees.
    """
    x = np.arctan2(rotations[..., 2, 1], rotations[..., 2, 2])
    y = np.arctan2(-rotations[..., 2, 0], np.hypot(rotations[..., 0, 0], rotations[..., 1, 0]))
    z = np.arctan2(rotations[..., 1, 0], rotations[..., 0, 0])
    return np.stack([x, y, z], axis=-1)
