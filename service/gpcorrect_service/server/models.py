"""The models of a server: what it asks of them, the name that replies carry, and how they are read."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from gpcorrect.correction import Correction
from gpcorrect.errors import ArtifactError
from gpcorrect.types import FloatArray, PoseSignal
from gpcorrect_service.protocol.limits import position_limit

ONE_OF_SEVERAL = re.compile(r"(.*?)(\d+|left|right)", re.IGNORECASE)
"""The name of an arm that has sisters: PSM1, raven2_left."""

CHECK_TOLERANCE = 1e-7  # m and rad: as when a model file is read


class PoseStream(Protocol):
    """One live path of poses: velocity and memory come from those that went before."""

    def reset(self) -> None:
        """Forget the past."""

    def correct(self, time: float, pose: FloatArray, twist: FloatArray | None = None) -> Correction:
        """Return the command for a pose.

        Parameters
        ----------
        time : float
            s.
        pose : (7,) or (3,) array
        twist : (6,) array, optional
        """


class Corrector(Protocol):
    """A model of poses. Several threads call it at once, so answering must not change it."""

    def correct(self, pose: FloatArray, twist: FloatArray | None = None) -> Correction:
        """Return the command for one pose.

        Parameters
        ----------
        pose : (7,) or (3,) array
        twist : (6,) array, optional
        """

    def correct_path(self, poses: FloatArray, times: FloatArray) -> Correction:
        """Return the commands for a path.

        Parameters
        ----------
        poses : (n, 7) or (n, 3) array
        times : (n,) array
            s.
        """

    def stream(self) -> PoseStream:
        """Begin a live path."""

    def info(self) -> Mapping[str, Any]:
        """Return the model's description, ready for JSON."""


class JointStream(Protocol):
    """One live path of joints: carries velocity and slack on from sample to sample."""

    def reset(self) -> None:
        """Forget the past."""

    def correct(self, time: float, q: FloatArray, effort: FloatArray | None = None) -> Correction:
        """Return corrected joints of one sample.

        Parameters
        ----------
        time : float
            s.
        q, effort : (d,) arrays
        """


class JointCorrector(Protocol):
    """A model of joints."""

    @property
    def types(self) -> str:
        """R or P for each joint."""

    def correct_path(
        self, q: FloatArray, times: FloatArray, efforts: FloatArray | None, sessions: Sequence[int] | None
    ) -> Correction:
        """Return corrected joints of a path that begins at rest.

        Parameters
        ----------
        q, efforts : (n, d) arrays
        times : (n,) array
            s.
        sessions : n int or None
            Where the number changes the path begins anew.
        """

    def stream(self) -> JointStream:
        """Begin a live path."""

    def info(self) -> Mapping[str, Any]:
        """Return the model's description, ready for JSON."""


class Check:
    """A model's answers to its own check queries, as they were when it was loaded.

    Parameters
    ----------
    corrector
        With a method `check_answers`, as every fitted model has; without one nothing is known.
    """

    def __init__(self, corrector: object) -> None:
        self._ask: Callable[[], FloatArray] | None = getattr(corrector, "check_answers", None)
        self._expected = None if self._ask is None else self._ask()

    def passes(self) -> bool:
        """Whether the model still gives them, so that what went wrong lies in what it was asked."""
        if self._ask is None or self._expected is None:
            return False
        try:
            return bool(np.allclose(self._ask(), self._expected, rtol=0, atol=CHECK_TOLERANCE))
        except Exception:  # noqa: BLE001  # whatever it is, the model fails on its own queries
            return False


@dataclass(frozen=True)
class Model:
    """A model of poses with the name and the hash that every reply carries.

    Attributes
    ----------
    limit : float
        Distance from the origin, m, beyond which a position is taken for a mistake of units.
    """

    corrector: Corrector
    id: str = "unnamed"
    hash: str = ""
    limit: float = field(init=False)
    check: Check = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "limit", position_limit(self.corrector.info()))
        object.__setattr__(self, "check", Check(self.corrector))

    @property
    def frames(self) -> tuple[str, str]:
        """Names of the frames that poses come in and commands are in; empty where the model does not say."""
        frames = self.corrector.info().get("frames", {})
        return frames.get("input", ""), frames.get("output", "")

    def reference(self, poses: FloatArray) -> FloatArray:
        """Return what the registration alone commands; the poses themselves without one.

        Parameters
        ----------
        poses : (n, 7) or (n, 3) array
        """
        rigid = getattr(self.corrector, "rigid", None)
        if rigid is None:
            return poses
        mapped = rigid.apply(PoseSignal(poses[:, :3], poses[:, 3:] if poses.shape[1] == 7 else None))
        return mapped.position if mapped.quaternion is None else np.hstack([mapped.position, mapped.quaternion])

    def reference_position(self, pose: FloatArray) -> Sequence[float]:
        """Return where registration alone commands one pose to be, m.

        Parameters
        ----------
        pose : (7,) or (3,) array
        """
        position: list[float] = self.reference(pose[None])[0, :3].tolist()
        return position


@dataclass(frozen=True)
class JointModel:
    """A model of joints, named as in :class:`Model`."""

    corrector: JointCorrector
    id: str = "unnamed"
    hash: str = ""
    check: Check = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "check", Check(self.corrector))


def load_model(path: str | Path, name: str = "", expected: str = "") -> Model:
    """Read and verify a model file of poses, once.

    Parameters
    ----------
    path : path
    name : str
        What replies call it; the file's own name by default.
    expected : str
        SHA-256 that the file must have; any by default.

    Raises
    ------
    ArtifactError
        The file is missing, truncated, altered, of a newer schema, not the expected one, or no model file.
    """
    # Not above: reading models needs SciPy and scikit-learn, which a server of another corrector does not.
    from gpcorrect.calibration import CommandCorrector, load_with_hash

    corrector, digest = load_with_hash(path, CommandCorrector)
    return Model(corrector, name or Path(path).stem, _as_added(path, digest, expected))


def load_joint_model(path: str | Path, name: str = "", expected: str = "") -> JointModel:
    """Read and verify a model file of joints, once.

    Parameters
    ----------
    path, name, expected
        As for :func:`load_model`.

    Raises
    ------
    ArtifactError
        As :func:`load_model`.
    """
    from gpcorrect.calibration import JointCorrector as Calibrated
    from gpcorrect.calibration import load_with_hash

    corrector, digest = load_with_hash(path, Calibrated)
    return JointModel(corrector, name or Path(path).stem, _as_added(path, digest, expected))


def _as_added(path: str | Path, digest: str, expected: str) -> str:
    if expected and digest != expected:
        raise ArtifactError(
            f"model file {path} is refused: it is not the file that was added under this hash.",
            hint="Add it again: gpcorrect models add",
        )
    return digest


def check_arm(arm: str, *models: Model | JointModel | None) -> None:
    """Refuse models that were learned on another arm than each other, or on a sister of the arm that is served.

    Parameters
    ----------
    arm : str
        CRTK name. A model that was learned on PSM2 is refused for PSM1; what a model calls raven2_left may be arm1.
    *models : Model, JointModel or None

    Raises
    ------
    ArtifactError
        They were.
    """
    learned = [(model.id, name) for model in models if model and (name := model.corrector.info().get("arm", ""))]
    for model, name in learned:
        first, first_name = learned[0]
        if name != first_name:
            raise ArtifactError(
                f"model {first} was learned on {first_name}, model {model} on {name}: one server serves one arm.",
                hint="Serve each arm by itself: gpcorrect serve --arm NAME",
            )
        one, other = ONE_OF_SEVERAL.fullmatch(name), ONE_OF_SEVERAL.fullmatch(arm)
        if one and other and one[1] == other[1] and name != arm:
            raise ArtifactError(
                f"model {model} was learned on {name}, and the arm here is {arm}.",
                hint=f"Name a model of {arm}, or the arm: --arm {name}",
            )
