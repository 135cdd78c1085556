"""The models of a server: how they are read, the names that replies carry, and which of them answer now, if any."""

from __future__ import annotations

import re
import threading
import timeit
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np

from gpcorrect.calibration import (
    CommandCorrector,
    Entry,
    JointCorrector,
    ModelStore,
    load_with_hash,
    refuse_other_use,
)
from gpcorrect.errors import ArtifactError
from gpcorrect.types import FloatArray, PoseSignal
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.limits import position_limit
from gpcorrect_service.protocol.messages import State

M = TypeVar("M", "Model", "JointModel")

ONE_OF_SEVERAL = re.compile(r"(.*?)(\d+|left|right)", re.IGNORECASE)
"""The name of an arm that has sisters: PSM1, raven2_left."""

KINDS = ("pose", "joints")  # of models, of which a server holds one each
FAULTS_IN_A_ROW = 10  # chosen by hand: after so many failures without one answer a model is not asked any more
QUICK_SECONDS = 5e-4  # half of a planner's period at 1 kHz; what takes longer would hold up its connection
CHECK_TOLERANCE = 1e-7  # m and rad: as when a model file is read


class Check:
    """A model's answers to its own check queries, as they were when it was loaded.

    Every fitted model has a method `check_answers`; of one without nothing is known.
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
    """A model of poses with the name and the hash that every reply carries."""

    corrector: CommandCorrector
    id: str = "unnamed"
    hash: str = ""
    # distance from the origin, m, beyond which a position is taken for a mistake of units
    limit: float = field(init=False)
    # whether it was fitted and answers a pose before a worker would have been woken for it. Anybody's own corrector
    # may wait for something.
    quick: bool = field(init=False)
    check: Check = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "limit", position_limit(self.corrector.info()))
        object.__setattr__(self, "quick", _is_quick(self.corrector))
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
        return poses if rigid is None else rigid.apply(PoseSignal.of(poses)).table

    def reference_position(self, pose: FloatArray) -> list[float]:
        """Return where registration alone commands one pose to be, m.

        Parameters
        ----------
        pose : (7,) or (3,) array
        """
        position: list[float] = self.reference(pose[None])[0, :3].tolist()
        return position


def _is_quick(corrector: object) -> bool:
    """Whether a fitted model gave the fastest of five answers in that time."""
    if not isinstance(corrector, CommandCorrector) or not len(corrector.check_queries):
        return False
    pose = corrector.check_queries[0, : 7 if corrector.has_orientation else 3]
    seconds = timeit.repeat(lambda: corrector.correct(pose), number=1, repeat=5)
    return min(seconds) < QUICK_SECONDS


@dataclass(frozen=True)
class JointModel:
    """A model of joints, named as in :class:`Model`."""

    corrector: JointCorrector
    id: str = "unnamed"
    hash: str = ""
    check: Check = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "check", Check(self.corrector))


def load_model(path: str | Path) -> Model:
    """Read and verify a model file of poses, once.

    Parameters
    ----------
    path : path, its name without the ending is what replies call it

    Raises
    ------
    ArtifactError
        The file is missing, truncated, altered, of a newer schema, or no model file.
    """
    corrector, digest = load_with_hash(path, CommandCorrector)
    return Model(corrector, Path(path).stem, digest)


def load_joint_model(path: str | Path) -> JointModel:
    """Read and verify a model file of joints, once; raises as :func:`load_model`.

    Parameters
    ----------
    path : path
    """
    corrector, digest = load_with_hash(path, JointCorrector)
    return JointModel(corrector, Path(path).stem, digest)


def load_entry(store: ModelStore, entry: Entry) -> Model | JointModel:
    """Return a model of a store, verified and tried on its recorded check queries; ArtifactError if refused.

    Parameters
    ----------
    store : ModelStore
    entry : Entry
    """
    made = Model if entry.kind == "pose" else JointModel
    return made(store.verified(entry), entry.id, entry.hash)


def load_next(store: ModelStore, entry: Entry, active: Active, arm: str) -> Model | JointModel:
    """Return a model of a store that may follow the active one of its kind; raises as :func:`load_entry`.

    Parameters
    ----------
    store : ModelStore
    entry : Entry
    active : Active, what answers now: the new one is of the same use, and of the same arm as the one of the other kind
    arm : str, as in :func:`check_arm`
    """
    model = load_entry(store, entry)
    check_arm(arm, model, active.joints if entry.kind == "pose" else active.pose)
    if (before := active.of(entry.kind)) is not None:
        refuse_other_use(model.id, model.corrector.info(), before.corrector.info())
    return model


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
            cause = f"model {first} was learned on {first_name}, model {model} on {name}: one server serves one arm."
            raise ArtifactError(cause, hint="Serve each arm by itself: gpcorrect serve --arm NAME")
        one, other = ONE_OF_SEVERAL.fullmatch(name), ONE_OF_SEVERAL.fullmatch(arm)
        if one and other and one[1] == other[1] and name != arm:
            hint = f"Name a model of {arm}, or the arm: --arm {name}"
            raise ArtifactError(f"model {model} was learned on {name}, and the arm here is {arm}.", hint=hint)


class Active:
    """Holds the models of poses and of joints, if any; safe to use from several threads.

    A query is answered by the model that was there when its handler asked for it, from its first byte to its last.
    """

    def __init__(self, pose: Model | None = None, joints: JointModel | None = None) -> None:
        self.pose, self.joints = pose, joints
        self._paused = False
        self._failures = 0
        self._lock = threading.Lock()
        self.changing = threading.Lock()  # held from the look at what is active to another model's activation

    def of(self, kind: str) -> Model | JointModel | None:
        """Return the model of a kind.

        Parameters
        ----------
        kind : str, "pose" or "joints"
        """
        return self.pose if kind == "pose" else self.joints

    @property
    def hashes(self) -> tuple[str, str]:
        """SHA-256 of the models of poses and of joints; empty where there is none, or it has none."""
        pose, joints = self.pose, self.joints
        return pose.hash if pose else "", joints.hash if joints else ""

    @property
    def state(self) -> State:
        """The CRTK state: DISABLED without any model, PAUSED by an operator, FAULT when the model keeps failing."""
        if self._failures >= FAULTS_IN_A_ROW:
            return "FAULT"
        if self._paused:
            return "PAUSED"
        return "DISABLED" if self.pose is None and self.joints is None else "ENABLED"

    def activate(self, model: Model | JointModel) -> None:
        """Answer with another model from the next query on; those under way end with what they began with.

        Parameters
        ----------
        model : Model or JointModel
        """
        with self._lock:
            if isinstance(model, JointModel):
                self.joints = model
            else:
                self.pose = model
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
        """Return the model that answers poses; NO_MODEL where there is none, BUSY while paused, INTERNAL in FAULT."""
        return self._answering(self.pose, "for poses", "gpcorrect serve MODEL")

    def joint_model(self) -> JointModel:
        """Return the model that answers joints; raises as :meth:`pose_model`."""
        return self._answering(self.joints, "for joints", "gpcorrect serve --joints JOINT_MODEL")

    def _answering(self, model: M | None, what: str, start: str) -> M:
        state = self.state if self._paused or self._failures else "ENABLED"
        if state == "PAUSED":
            hint = "Ask a replica, or: gpcorrect models state ENABLED"
            raise ServiceError("BUSY", "this server is PAUSED by its operator.", hint=hint)
        if state == "FAULT":
            cause = f"this server is in FAULT: its model failed {FAULTS_IN_A_ROW} times in a row."
            hint = "Activate another model, or look into the server's log and then: gpcorrect models state ENABLED"
            raise ServiceError("INTERNAL", cause, hint=hint)
        if model is None:
            cause = f"this server holds no model {what}."
            raise ServiceError("NO_MODEL", cause, hint=f"Start it with one: {start}")
        return model
