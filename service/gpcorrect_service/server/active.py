"""Which models answer at this moment, and whether they do."""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace

from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.messages import State
from gpcorrect_service.server.models import JointModel, Model

FAULTS_IN_A_ROW = 10  # chosen by hand: after so many failures without one answer a model is not asked any more


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
            part = "joints" if isinstance(model, JointModel) else "pose"
            self._now = replace(self._now, **{part: model})  # type: ignore[arg-type]  # its own part
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
