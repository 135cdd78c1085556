"""The models of a server: the names that replies carry, and how they are read; threads ask them at once."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gpcorrect.calibration import CommandCorrector, JointCorrector, load_with_hash
from gpcorrect.errors import ArtifactError
from gpcorrect.types import FloatArray, PoseSignal
from gpcorrect_service.protocol.limits import position_limit

ONE_OF_SEVERAL = re.compile(r"(.*?)(\d+|left|right)", re.IGNORECASE)
"""The name of an arm that has sisters: PSM1, raven2_left."""

CHECK_TOLERANCE = 1e-7  # m and rad: as when a model file is read


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

    corrector: CommandCorrector
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

    def reference_position(self, pose: FloatArray) -> list[float]:
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
    corrector, digest = load_with_hash(path, CommandCorrector)
    return Model(corrector, name or Path(path).stem, _as_added(path, digest, expected))


def load_joint_model(path: str | Path, name: str = "", expected: str = "") -> JointModel:
    """Read and verify a model file of joints, once; raises as :func:`load_model`.

    Parameters
    ----------
    path, name, expected
        As for :func:`load_model`.
    """
    corrector, digest = load_with_hash(path, JointCorrector)
    return JointModel(corrector, name or Path(path).stem, _as_added(path, digest, expected))


def _as_added(path: str | Path, digest: str, expected: str) -> str:
    if expected and digest != expected:
        raise ArtifactError(
            f"model file {path} is refused: it is not the file that was added under this hash.",
            hint="Add it again: gpcorrect models add",
        )
    return digest


def check_arm(arm: str, *models: Model | JointModel | None) -> None:
    """Refuse, with an ArtifactError, models of different arms, or of a sister of the arm that is served.

    Parameters
    ----------
    arm : str
        CRTK name. A model that was learned on PSM2 is refused for PSM1; what a model calls raven2_left may be arm1.
    *models : Model, JointModel or None
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
