"""What a planner gets back, and the model, bounds and registration that a stream of questions is held to."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any, Literal

import msgspec
import numpy as np

from gpcorrect.correction import Correction, Reason
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray, PoseSignal
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.limits import position_limit
from gpcorrect_service.protocol.messages import Kind, ModelAnswer, ReplyMeta

if TYPE_CHECKING:
    from gpcorrect.rigid import RigidModel

ASK_AGAIN = 10.0  # s, chosen by hand: between questions for a registration that nobody gives


class Reply(msgspec.Struct, frozen=True, eq=False):
    """The answer to one question, about one pose or n rows.

    Parameters
    ----------
    answer : Correction
        In a fallback the registered pose or the reported joints themselves, with unknown (NaN) uncertainty.
    meta : ReplyMeta, which model and process answered; empty in a fallback
    failure : ServiceError or None, why no server answered, in a fallback
    """

    answer: Correction
    meta: ReplyMeta = ReplyMeta()
    failure: ServiceError | None = None

    @property
    def position(self) -> FloatArray:
        """Command (3,) or (n, 3), base frame, m."""
        assert self.answer.position is not None, "this reply holds joints"
        return self.answer.position

    @property
    def quaternion(self) -> FloatArray | None:
        """Command (4,) or (n, 4) wxyz; None when none was asked for."""
        return self.answer.quaternion

    @property
    def pose(self) -> FloatArray:
        """The command as (7,) or (n, 7) x y z qw qx qy qz, or (3,) or (n, 3)."""
        quaternion = self.quaternion
        return self.position if quaternion is None else np.concatenate([self.position, quaternion], axis=-1)

    @property
    def joints(self) -> FloatArray:
        """Joints (n, d), rad or m; NaN where a number was missing."""
        assert self.answer.joints is not None, "this reply holds poses"
        return self.answer.joints

    @property
    def std(self) -> FloatArray:
        """Standard deviations: m, then rad; NaN where not learned."""
        return self.answer.std

    @property
    def interval95(self) -> FloatArray:
        """Half widths of the 95 % intervals, as :attr:`std`."""
        return self.answer.interval95

    @property
    def in_domain(self) -> Any:
        """Whether the query lies near training data: bool, or (n,) bool array; false in a fallback."""
        return self.answer.in_domain

    @property
    def status(self) -> Any:
        """OK, EXTRAPOLATING, LIMITED or MISSING, in a fallback the failure; a tuple of n of them for n rows."""
        return self.answer.status if self.failure is None else self._repeated(self.failure.status)

    @property
    def reason(self) -> Any:
        """Why the status is not OK, or what was not used; a tuple of n texts for n rows."""
        return self.answer.reason if self.failure is None else self._repeated(self.failure.message)

    @property
    def fallback(self) -> Literal["", "identity"]:
        """Whether nothing learned is in this answer because no server corrected it ("identity")."""
        return "" if self.failure is None else "identity"

    def _repeated(self, text: str) -> Any:
        return (text,) * len(self.answer) if isinstance(self.answer.reasons, np.ndarray) else text


def uncorrected(rows: FloatArray, failure: ServiceError, *, joints: bool = False) -> Reply:
    """Return poses in the frame of commands, or joints, as an answer that nobody corrected, with the failure.

    Parameters
    ----------
    rows : (7,), (3,), (n, 7) or (n, 3) array, or (n, d) joints, what registration alone commands; joints as they are
    failure : ServiceError
    joints : bool
    """
    unknown = np.full(rows.shape if joints else (*rows.shape[:-1], 6), np.nan)
    outside: Any = Reason.OUTSIDE if rows.ndim == 1 else np.full(len(rows), int(Reason.OUTSIDE))
    if joints:
        return Reply(Correction(None, None, rows, unknown, unknown, outside), failure=failure)
    quaternion = rows[..., 3:] if rows.shape[-1] > 3 else None
    return Reply(Correction(rows[..., :3], quaternion, None, unknown, unknown, outside), failure=failure)


class PinnedModels:
    """Holds a client to the model that answered it first, and to its operator's bounds: others lie millimetres apart.

    Poses and joints have a model each. Safe to use from several threads.

    Parameters
    ----------
    model_hash : str, SHA-256 of the model that must answer; empty takes the one that answers first
    hold : bool, whether other models are refused at all
    """

    def __init__(self, model_hash: str = "", *, hold: bool = True) -> None:
        self._hold = hold
        self._asked_at = -ASK_AGAIN
        self._registration: tuple[str, RigidModel | None] | None = None
        # distance from the origin, m, up to which the server with that registration takes poses
        self.limit = math.inf
        self.change(model_hash)

    def change(self, model_hash: str = "") -> None:
        """Take another model from the next answer on; its hash as for the class."""
        self._required = model_hash
        self._hashes: dict[str, str] = {}
        self._bounds: dict[str, str] = {}

    def check(self, kind: Kind, meta: ReplyMeta) -> None:
        """Refuse, as OTHER_MODEL, the answer of another model or with other bounds.

        Parameters
        ----------
        kind : str
        meta : ReplyMeta
        """
        task, hashes = "joints" if kind == "correct_joints" else "pose", self._hashes
        if not self._hold:
            hashes[task] = meta.model_hash
            return
        held = hashes.setdefault(task, self._required or meta.model_hash)
        if held != meta.model_hash:
            raise ServiceError(
                "OTHER_MODEL",
                f"this stream is held to model {held[:12]}, and {meta.replica} answers with {meta.model_hash[:12]} "
                f"({meta.model_id}).",
                hint="Bring the robot to rest and call change_model(), or let all servers have the same model: "
                "gpcorrect models activate",
            )
        bounds = self._bounds.setdefault(task, meta.bounds)
        if bounds != meta.bounds:
            raise ServiceError(
                "OTHER_MODEL",
                f"this stream is held to answers within {bounds or 'no bounds'}, and {meta.replica} answers within "
                f"{meta.bounds or 'none'}.",
                hint="Bring the robot to rest and call change_model(), or serve all replicas with the same --max-mm, "
                "--max-deg and --strict.",
            )

    @property
    def wants_registration(self) -> bool:
        """Whether the registration of the model of poses is to be asked for now; true once in a while."""
        held, known = self._hashes.get("pose"), self._registration
        now = time.monotonic()
        if held is None or (known is not None and known[0] == held) or now < self._asked_at + ASK_AGAIN:
            return False
        self._asked_at = now
        return True

    def learn(self, answer: ModelAnswer) -> None:
        """Take the registration of a server's model; OTHER_MODEL where it is not the one that answers this stream.

        Parameters
        ----------
        answer : ModelAnswer
        """
        bounds = self._bounds.get("pose", "")
        self.check("correct", ReplyMeta("", answer.id, answer.hash, answer.replica, bounds=bounds))
        from gpcorrect.rigid import RigidModel  # not above: most clients never need it

        known = None if answer.registration is None else RigidModel.from_dict(answer.registration)
        self._registration, self.limit = (answer.hash, known), position_limit(answer.info)

    def registered(self, poses: FloatArray) -> FloatArray | None:
        """Return what registration alone commands, or None where it is not known.

        Parameters
        ----------
        poses : (7,), (3,), (n, 7) or (n, 3) array
        """
        held, known = self._hashes.get("pose"), self._registration
        if known is None or known[0] != held or known[1] is None:
            return None
        try:
            mapped = known[1].apply(PoseSignal.of(poses.reshape(-1, poses.shape[-1])))
        except DataError:  # a lever arm, and no orientation to turn it with
            return None
        return mapped.table.reshape(poses.shape)
