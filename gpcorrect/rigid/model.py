"""The rigid part of the correction, and the residual that it leaves as a vector the Gaussian process can learn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Self, get_args

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, FloatArray, PoseSignal, frozen_array

RigidKind = Literal["identity", "pose", "marker", "separate", "position"]

ROTATION_TOLERANCE = 1e-6  # of R R^T - I: rounding is 1e-15, a matrix typed with six digits passes
SHAPES = {"R_position": (3, 3), "t": (3,), "offset": (3,), "R_left": (3, 3), "R_right": (3, 3)}


@dataclass(frozen=True, eq=False)
class RigidModel:
    """Maps observations on commands: `p = R_position (p_obs + R_obs offset) + t`, `R = R_left R_obs R_right`.

    Parameters
    ----------
    kind : str
        "identity": both frames agree. "pose": one rigid motion of the whole pose (`R_left` is `R_position`).
        "marker": the same and a marker that is not the tool tip (`offset`, `R_right`). "separate": position
        and orientation belong to different points of the tool, each registered for itself. "position":
        registered from positions alone; an orientation only changes frame.
    R_position : (3, 3) array, rotation of the observer's frame into the command's frame, as positions see it
    t : (3,) array, origin of the observer's frame in the command's frame, m
    offset : (3,) array, lever arm from the marker to the tool tip, in the tracked body's frame, m
    R_left, R_right : (3, 3) arrays
        Rotation of the frames, as orientations see it, and orientation of the tool tip in the tracked body.

    Raises
    ------
    DataError
        An unknown kind, a wrong shape, or a matrix that is not a rotation.
    """

    kind: RigidKind = "identity"
    R_position: FloatArray = field(default_factory=lambda: np.eye(3))
    t: FloatArray = field(default_factory=lambda: np.zeros(3))
    offset: FloatArray = field(default_factory=lambda: np.zeros(3))
    R_left: FloatArray = field(default_factory=lambda: np.eye(3))
    R_right: FloatArray = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        if self.kind not in get_args(RigidKind):
            raise DataError(f"a rigid model is one of {', '.join(get_args(RigidKind))}, got {self.kind!r}.")
        for name, shape in SHAPES.items():
            value = frozen_array(getattr(self, name))
            if value.shape != shape or not np.isfinite(value).all():
                raise DataError(f"{name} of a rigid model must be finite with shape {shape}, got shape {value.shape}.")
            skew = np.abs(value @ value.T - np.eye(3)).max() if shape == (3, 3) else 0.0
            if skew > ROTATION_TOLERANCE or (shape == (3, 3) and np.linalg.det(value) < 0.0):
                raise DataError(f"{name} of a rigid model must be a rotation matrix, got {value.tolist()}.")
            object.__setattr__(self, name, value)

    @property
    def needs_orientation(self) -> bool:
        """Whether a position can only be mapped together with an orientation (there is a lever arm)."""
        return bool(np.any(self.offset != 0.0))

    def apply(self, observed: PoseSignal) -> PoseSignal:
        """Return the poses that `observed` are in the command's frame, at the commanded point of the tool.

        Parameters
        ----------
        observed : PoseSignal, poses in the observer's frame

        Raises
        ------
        DataError
            The model has a lever arm and `observed` has no orientations to turn it with.
        """
        if observed.quaternion is None:
            return PoseSignal(self._positions(observed.position, None))
        R_obs = se3.matrix_from_quaternion(observed.quaternion)
        quaternion = se3.quaternion_from_matrix(self.R_left @ R_obs @ self.R_right)
        return PoseSignal(self._positions(observed.position, R_obs), quaternion)

    def inverse(self, command: PoseSignal) -> PoseSignal:
        """Return the poses in the observer's frame that :meth:`apply` takes to `command`.

        Parameters
        ----------
        command : PoseSignal, poses in the command's frame
        """
        position = (command.position - self.t) @ self.R_position
        if command.quaternion is None:
            return PoseSignal(position - self._levers(None))
        R_obs = self.R_left.T @ se3.matrix_from_quaternion(command.quaternion) @ self.R_right.T
        return PoseSignal(position - self._levers(R_obs), se3.quaternion_from_matrix(R_obs))

    def _positions(self, position: FloatArray, R_obs: FloatArray | None) -> FloatArray:
        return (position + self._levers(R_obs)) @ self.R_position.T + self.t

    def _levers(self, R_obs: FloatArray | None) -> FloatArray:
        """Return from the marker to the tool tip `(n, 3)`, or `(3,)` zeros where they are one point."""
        if not self.needs_orientation:
            return self.offset
        if R_obs is None:
            raise DataError(
                "a model with a marker offset needs orientations to map positions, got positions only.",
                hint='Give orientations, or register with marker="none".',
            )
        return np.asarray(R_obs @ self.offset)

    def followed_by(self, other: RigidModel) -> RigidModel:
        """Return the model that maps as this one and then `other` do.

        Parameters
        ----------
        other : RigidModel, without a marker offset of its own: it maps poses that are in the command's frame already
        """
        return RigidModel(
            kind=self.kind if self.kind in ("marker", "separate") else other.kind,
            R_position=other.R_position @ self.R_position,
            t=other.R_position @ self.t + other.t,
            offset=self.offset,
            R_left=other.R_left @ self.R_left,
            R_right=self.R_right @ other.R_right,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the model as plain lists and text, exact to the last bit through JSON."""
        return {"kind": self.kind, **{name: getattr(self, name).tolist() for name in SHAPES}}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Rebuild a model from :meth:`to_dict`.

        Parameters
        ----------
        data : mapping, from :meth:`to_dict`
        """
        missing = [name for name in ("kind", *SHAPES) if name not in data]
        if missing:
            raise DataError(f"a stored rigid model lacks {', '.join(missing)}.")
        return cls(kind=data["kind"], **{name: data[name] for name in SHAPES})


def pose_residual(reference: PoseSignal, command: PoseSignal) -> FloatArray:
    """Residuals `(n, 6)` that :func:`apply_residual` adds to `reference` to reach `command`.

    The first three are the difference of the positions (m, common frame), the last three the rotation vector
    of `R_command R_reference^T` (rad, common frame, length at most pi). The rotation is NaN where either side
    measures positions only, and every component of a missing sample is NaN.

    Parameters
    ----------
    reference : PoseSignal, n poses
    command : PoseSignal, n poses in the same frame

    Raises
    ------
    DataError
        The two signals differ in length.
    """
    if len(reference) != len(command):
        raise DataError(
            f"the two signals must have a row for each other, got {len(reference)} and {len(command)} samples."
        )
    residual = np.full((len(reference), 6), np.nan)
    residual[:, :3] = command.position - reference.position
    if reference.quaternion is not None and command.quaternion is not None:
        rows = reference.finite & command.finite
        R_ref = se3.matrix_from_quaternion(reference.quaternion[rows])
        R_cmd = se3.matrix_from_quaternion(command.quaternion[rows])
        residual[rows, 3:] = se3.rotvec_from_matrix(R_cmd @ np.swapaxes(R_ref, -1, -2))
    return residual


def apply_residual(reference: PoseSignal, residual: FloatArray) -> PoseSignal:
    """Poses reached from `reference` by residuals `(n, 6)`: `p + r[:3]` and `exp(r[3:]) R`.

    Where the rotation part is NaN (nothing was learned of orientations) the orientation stays as it is.

    Parameters
    ----------
    reference : PoseSignal, n poses
    residual : (n, 6) array, m, then rad; NaN where nothing was learned

    Raises
    ------
    DataError
        The residuals are not `(n, 6)` with a row a pose.
    """
    residual = np.asarray(residual, dtype=np.float64)
    if residual.shape != (len(reference), 6):
        raise DataError(f"residuals must have shape ({len(reference)}, 6), got {residual.shape}.")
    position = reference.position + residual[:, :3]
    if reference.quaternion is None:
        return PoseSignal(position)
    rows: BoolArray = reference.finite & np.isfinite(residual[:, 3:]).all(axis=1)
    quaternion = np.array(reference.quaternion)
    turn = se3.matrix_from_rotvec(residual[rows, 3:])
    quaternion[rows] = se3.quaternion_from_matrix(turn @ se3.matrix_from_quaternion(quaternion[rows]))
    return PoseSignal(position, quaternion)
