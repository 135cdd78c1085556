"""What the service asks of a corrector, and the identity that its replies carry."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from gpcorrect.types import BoolArray, Correction, FloatArray, PoseSignal
from gpcorrect_service.protocol.limits import position_limit

__all__ = [
    "Corrector",
    "JointModel",
    "JointResult",
    "JointStreamLike",
    "Model",
    "PathResult",
    "load_joint_model",
    "load_model",
]


class PathResult(Protocol):
    """A corrected path, as `gpcorrect.corrector.PathCorrection`."""

    @property
    def positions(self) -> FloatArray:
        """(n, 3), m."""

    @property
    def quaternions(self) -> FloatArray | None:
        """(n, 4) wxyz."""

    @property
    def std(self) -> FloatArray:
        """(n, 6), m and rad."""

    @property
    def interval95(self) -> FloatArray:
        """(n, 6), m and rad."""

    @property
    def in_domain(self) -> BoolArray:
        """(n,)."""

    @property
    def status(self) -> tuple[str, ...]:
        """N names."""

    @property
    def reason(self) -> tuple[str, ...]:
        """N texts."""


class Corrector(Protocol):
    """What is served. Several threads call it at once, so answering must not change it."""

    def correct(self, pose: FloatArray, twist: FloatArray | None = None) -> Correction:
        """Return the command for one pose `(7,)` or `(3,)` and twist `(6,)`."""

    def correct_path(self, poses: FloatArray, times: FloatArray) -> PathResult:
        """Return the commands for poses `(n, 7)` or `(n, 3)` at `times` `(n,)`."""

    def info(self) -> Mapping[str, Any]:
        """Return what the model says of itself, ready for JSON."""


class JointStreamLike(Protocol):
    """One live path of joints: carries velocity and slack on from sample to sample."""

    def reset(self) -> None:
        """Forget the past."""

    def estimate(self, time: float, q: FloatArray, effort: FloatArray | None = None) -> JointResult:
        """Return corrected joints and standard deviations `(d,)` at `time`, s."""


class JointResult(Protocol):
    """Corrected joints, as `gpcorrect.joint_corrector.JointEstimate`."""

    @property
    def q(self) -> FloatArray:
        """(d,), rad or m."""

    @property
    def std(self) -> FloatArray:
        """(d,), rad or m."""


@dataclass(frozen=True)
class Model:
    """A corrector with the name and the hash that every reply carries.

    Attributes
    ----------
    limit : float
        Distance from the origin, m, beyond which a position is taken for a mistake of units.
    """

    corrector: Corrector
    id: str = "unnamed"
    hash: str = ""
    limit: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "limit", position_limit(self.corrector.info()))

    def reference(self, poses: FloatArray) -> FloatArray:
        """Return what the registration alone commands for poses `(n, 7)` or `(n, 3)`; they themselves without one."""
        rigid = getattr(self.corrector, "rigid", None)
        if rigid is None:
            return poses
        mapped = rigid.apply(PoseSignal(poses[:, :3], poses[:, 3:] if poses.shape[1] == 7 else None))
        return mapped.position if mapped.quaternion is None else np.hstack([mapped.position, mapped.quaternion])


@dataclass(frozen=True)
class JointModel:
    """A joint calibration, as the service uses it.

    Parameters
    ----------
    stream : callable
        Begins a live path; every request and every stream has its own.
    types : str
        "R" or "P" for each joint.
    info : mapping
        What the model says of itself, ready for JSON.
    id, hash : str
        As in :class:`Model`.
    """

    stream: Callable[[], JointStreamLike]
    types: str
    info: Mapping[str, Any] = field(default_factory=dict)
    id: str = "unnamed"
    hash: str = ""


def load_model(path: str | Path, name: str = "") -> Model:
    """Read and verify a model file of poses; `name` (the file's own by default) is what replies call it.

    Raises
    ------
    ArtifactError
        The file is missing, truncated, altered, of a newer schema, or no model file.
    """
    # Not above: reading models needs SciPy and scikit-learn, which a server of another corrector does not.
    from gpcorrect import artifact

    return Model(artifact.load(path), id=name or Path(path).stem, hash=artifact.model_hash(path))


def load_joint_model(path: str | Path, name: str = "") -> JointModel:
    """Read and verify a model file of joints, as :func:`load_model`."""
    from gpcorrect.artifact import model_hash
    from gpcorrect.joint_artifact import load_joint
    from gpcorrect.joint_corrector import JointStream

    corrector = load_joint(path)
    info = {**corrector.summary, "method": corrector.method, "direction": corrector.direction}
    return JointModel(
        lambda: JointStream(corrector), corrector.types, info, id=name or Path(path).stem, hash=model_hash(path)
    )
