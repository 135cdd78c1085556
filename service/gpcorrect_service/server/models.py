"""The models of a server: what it asks of them, the name that replies carry, and which ones are active."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from gpcorrect.correction import Correction
from gpcorrect.errors import ArtifactError
from gpcorrect.types import FloatArray, PoseSignal
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.limits import position_limit
from gpcorrect_service.protocol.messages import State

__all__ = ["Active", "Corrector", "JointCorrector", "JointModel", "JointStream", "Model", "PoseStream"]
__all__ += ["Snapshot", "check_arm", "load_joint_model", "load_model"]

FAULTS_IN_A_ROW = 10  # chosen by hand: after so many failures without one answer a model is not asked any more


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
    from gpcorrect.calibration import load

    return Model(load(path), name or Path(path).stem, _hash_of(path, expected))


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
    from gpcorrect.calibration import load

    return JointModel(load(path, Calibrated), name or Path(path).stem, _hash_of(path, expected))


def _hash_of(path: str | Path, expected: str) -> str:
    from gpcorrect.calibration import model_hash

    digest = model_hash(path)
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


@dataclass(frozen=True)
class Snapshot:
    """The models of one moment; a query is answered by one snapshot from its first byte to its last."""

    pose: Model | None = None
    joints: JointModel | None = None


class Active:
    """Holds the snapshot, and swaps it whole; safe to use from several threads.

    Parameters
    ----------
    pose : Model or None
    joints : JointModel or None
    """

    def __init__(self, pose: Model | None = None, joints: JointModel | None = None) -> None:
        self._now = Snapshot(pose, joints)
        self._paused = False
        self._failures = 0
        self._lock = threading.Lock()

    @property
    def now(self) -> Snapshot:
        """The models of this moment."""
        return self._now

    @property
    def hashes(self) -> tuple[str, str]:
        """SHA-256 of the models of poses and of joints; empty where there is none, or it has none."""
        now = self._now
        return now.pose.hash if now.pose else "", now.joints.hash if now.joints else ""

    @property
    def state(self) -> State:
        """The CRTK state: DISABLED without any model, PAUSED by an operator, FAULT when the model keeps failing."""
        if self._failures >= FAULTS_IN_A_ROW:
            return "FAULT"
        if self._paused:
            return "PAUSED"
        return "DISABLED" if self._now == Snapshot() else "ENABLED"

    def activate(self, model: Model | JointModel) -> None:
        """Answer with another model from the next query on; those under way end with what they began with.

        Parameters
        ----------
        model : Model or JointModel
        """
        with self._lock:
            if isinstance(model, JointModel):
                self._now = replace(self._now, joints=model)
            else:
                self._now = replace(self._now, pose=model)
            self._failures = 0

    def pause(self, paused: bool) -> None:
        """Stop answering, or go on; going on also leaves FAULT.

        Parameters
        ----------
        paused : bool
        """
        with self._lock:
            self._paused = paused
            self._failures = 0 if not paused else self._failures

    def failed(self) -> None:
        """Note that the model failed on a query."""
        with self._lock:
            self._failures += 1

    def answered(self) -> None:
        """Note that the model answered."""
        if self._failures:
            with self._lock:
                self._failures = 0 if self._failures < FAULTS_IN_A_ROW else self._failures

    def pose_model(self) -> Model:
        """Return the model that answers poses.

        Raises
        ------
        ServiceError
            NO_MODEL: there is none; BUSY: paused; INTERNAL: in FAULT.
        """
        self._check_enabled()
        model = self._now.pose
        if model is None:
            raise _no_model("for poses", "gpcorrect serve MODEL")
        return model

    def joint_model(self) -> JointModel:
        """Return the model that answers joints; raises as :meth:`pose_model`."""
        self._check_enabled()
        model = self._now.joints
        if model is None:
            raise _no_model("for joints", "gpcorrect serve --joints JOINT_MODEL")
        return model

    def _check_enabled(self) -> None:
        if not (self._paused or self._failures):
            return
        state = self.state
        if state == "PAUSED":
            raise ServiceError(
                "BUSY",
                "this server is PAUSED by its operator.",
                hint="Ask a replica, or: gpcorrect models state ENABLED",
            )
        if state == "FAULT":
            raise ServiceError(
                "INTERNAL",
                f"this server is in FAULT: its model failed {FAULTS_IN_A_ROW} times in a row.",
                hint="Activate another model, or look into the server's log and then: gpcorrect models state ENABLED",
            )


def _no_model(what: str, start: str) -> ServiceError:
    return ServiceError("NO_MODEL", f"this server holds no model {what}.", hint=f"Start it with one: {start}")
