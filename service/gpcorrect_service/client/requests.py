"""Questions without the network: what is sent, and what a reply means."""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Callable, Sequence
from typing import Generic, TypeVar, cast

import msgspec
import numpy as np
import zenoh
from numpy.typing import ArrayLike

from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray
from gpcorrect_service.client.replies import PinnedModels, Reply, uncorrected
from gpcorrect_service.protocol import messages
from gpcorrect_service.protocol.answer import JointsAnswer, PathAnswer, PoseAnswer, Rows, Single, nullable, unpack
from gpcorrect_service.protocol.errors import FailureStatus, ServiceError, bad_input
from gpcorrect_service.protocol.limits import checked_pose
from gpcorrect_service.protocol.messages import CODECS, error_codec
from gpcorrect_service.protocol.settings import MAX_MESSAGE_BYTES, ClientSettings, OnFailure

S = TypeVar("S", bound=msgspec.Struct)
R = TypeVar("R")

# Another replica may do better with these; bad input is bad everywhere.
WORTH_A_RETRY = frozenset({"BUSY", "STALE", "NO_MODEL", "INTERNAL", "NO_SERVICE", "OTHER_MODEL"})


class Question(msgspec.Struct, Generic[R], frozen=True, eq=False):
    """A request ready to send, and how its reply is read."""

    kind: messages.Kind  # which key is asked
    payload: bytes
    encoding: str  # zenoh's name of how they are written
    attachment: bytes
    read: Callable[[zenoh.Reply], R]  # from zenoh's reply to the planner's; raises the server's refusal
    patience: float  # s after which a reply of one attempt is too old to be used; for both together it is twice that
    begun: float  # when the caller asked, s of the monotonic clock
    # from the failure to the answer that replaces it; None raises the failure
    fallback: Callable[[ServiceError], R] | None = None

    def answer(self, reply: zenoh.Reply, waited: float) -> R | ServiceError:
        """Return the answer in a reply, or the failure when another reply may be better; raises one that is final.

        Parameters
        ----------
        reply : zenoh.Reply
        waited : float, s since it was asked for
        """
        # A process that was stopped finds replies of long ago when it goes on.
        if reply.ok is not None and waited > self.patience:
            return _stale(waited, self.patience)
        try:
            return self.read(reply)
        except ServiceError as error:
            if error.status not in WORTH_A_RETRY:
                raise
            return error

    def require_wanted(self, waited: float) -> None:
        """Refuse, as STALE, to hand out an answer that is older than the caller allowed, whatever held it up and where.

        Parameters
        ----------
        waited : float, s since the caller asked, every attempt included
        """
        if waited > 2 * self.patience:
            raise _stale(waited, 2 * self.patience)

    def rescue(self, error: ServiceError) -> R:
        """Return the fallback; raise the failure itself where there is none, or the caller's own input is at fault.

        Parameters
        ----------
        error : ServiceError
        """
        if self.fallback is None or error.status == "BAD_INPUT":
            raise error
        return self.fallback(error)


class RequestBuilder:
    """Writes questions in one encoding, "msgpack" or "json"; answers are wanted for half of the settings' timeouts.

    The other half is the retry's.
    """

    def __init__(
        self,
        settings: ClientSettings,
        encoding: str,
        on_failure: OnFailure = "raise",
        pinned: PinnedModels | None = None,
    ) -> None:
        if on_failure not in ("raise", "identity"):
            raise DataError(f"on_failure must be 'raise' or 'identity', got {on_failure!r}.")
        if encoding not in CODECS:
            raise DataError(f"encoding {encoding!r} is not known.", hint=f"Use one of: {', '.join(CODECS)}.")
        self._settings = settings
        self._codec = CODECS[encoding]
        self._identity = on_failure == "identity"
        self.pinned = pinned or PinnedModels()
        self._prefix = os.urandom(4).hex()
        self._numbers = itertools.count(1)

    def correct(self, pose: ArrayLike, twist: ArrayLike | None) -> Question[Reply]:
        """Ask what to command instead of one pose; arguments of this and the next two are those of the client's."""
        asked = _array(pose, "pose", 1)
        given = None if twist is None else tuple(_array(twist, "twist", 1).tolist())
        body = messages.CorrectRequest(tuple(asked.tolist()), given)
        return self._correction("correct", body, PoseAnswer, lambda error: self._registered(asked, error))

    def correct_path(self, poses: ArrayLike, times: ArrayLike) -> Question[Reply]:
        """Ask what to command instead of a path."""
        asked = _array(poses, "poses", 2)
        body = messages.CorrectPathRequest(tuple(asked.tolist()), tuple(_array(times, "times", 1).tolist()))
        return self._correction("correct_path", body, PathAnswer, lambda error: self._registered(asked, error))

    def correct_joints(
        self, q: ArrayLike, times: ArrayLike, efforts: ArrayLike | None, sessions: Sequence[int] | None
    ) -> Question[Reply]:
        """Ask what true joints belong to a path of reported ones."""
        joints = _array(q, "joints", 2)
        body = messages.CorrectJointsRequest(
            nullable(joints),
            tuple(_array(times, "times", 1).tolist()),
            None if efforts is None else nullable(_array(efforts, "efforts", 2)),
            None if sessions is None else tuple(int(one) for one in sessions),
        )
        return self._correction(
            "correct_joints", body, JointsAnswer, lambda error: uncorrected(joints, error, joints=True)
        )

    def metrics(self) -> Question[str]:
        """Ask for the server's numbers."""
        return self._question("metrics", None, lambda r: _accepted(r).payload.to_bytes().decode(errors="replace"))

    def registration(self) -> Question[None] | None:
        """Ask for the registration that a fallback needs, where it is not known yet."""
        if not (self._identity and self.pinned.wants_registration):
            return None
        return self._question(
            "model", None, lambda r: self.pinned.learn(self._decoded(messages.ModelAnswer, _accepted(r)))
        )

    def _registered(self, poses: FloatArray, error: ServiceError) -> Reply:
        """Return what registration alone commands; raises the failure itself where nobody ever answered."""
        for pose in poses.reshape(-1, poses.shape[-1]):
            checked_pose(pose.tolist(), self.pinned.limit)
        commands = self.pinned.registered(poses)
        if commands is None:
            raise error
        return uncorrected(commands, error)

    def plain(
        self, kind: messages.Kind, form: type[S], body: msgspec.Struct | None = None, deadline: float | None = None
    ) -> Question[S]:
        """Ask for a message that nothing travels beside.

        Parameters
        ----------
        kind : str
        form, body : type, Struct or None
            Of the answer, and the question.
        deadline : float, optional, seconds for which the answer is wanted; half of the timeout by default
        """
        return self._question(kind, body, lambda reply: self._decoded(form, _accepted(reply)), deadline=deadline)

    def _correction(
        self,
        kind: messages.Kind,
        body: msgspec.Struct,
        form: type[Single | Rows],
        identity: Callable[[ServiceError], Reply],
    ) -> Question[Reply]:
        def _read(reply: zenoh.Reply) -> Reply:
            sample = _accepted(reply)
            beside = b"" if sample.attachment is None else sample.attachment.to_bytes()
            try:
                meta = self._codec.decode(messages.ReplyMeta, beside)
            except ServiceError as error:
                raise no_service(f"a reply without the service's attachment ({error.message})") from error
            self.pinned.check(kind, meta)
            return Reply(unpack(self._decoded(form, sample)), meta)

        return self._question(kind, body, _read, identity if self._identity else None)

    def _question(
        self,
        kind: messages.Kind,
        body: msgspec.Struct | None,
        read: Callable[[zenoh.Reply], R],
        fallback: Callable[[ServiceError], R] | None = None,
        deadline: float | None = None,
    ) -> Question[R]:
        begun = time.monotonic()
        payload = b"" if body is None else self._codec.encode(body)
        if len(payload) > MAX_MESSAGE_BYTES:
            hint = "Send the path in parts, cut where the robot rests."
            raise bad_input(f"the request has {len(payload)} bytes; a server takes {MAX_MESSAGE_BYTES}.", hint)
        patience = self._settings.timeout_of(kind) / 2
        request_id = f"{self._prefix}-{next(self._numbers)}"
        meta = messages.RequestMeta(request_id=request_id, client_time=time.time(), deadline=deadline or patience)
        encoding, attachment = self._codec.encoding(kind), self._codec.encode(meta)
        return Question(kind, payload, encoding, attachment, read, patience, begun, fallback)

    def _decoded(self, form: type[S], sample: zenoh.Sample) -> S:
        try:
            return self._codec.decode(form, sample.payload.to_bytes())
        except ServiceError as error:
            raise no_service(f"a reply that is not the service's ({error.message})") from error


def _stale(waited: float, allowed: float) -> ServiceError:
    cause = f"the reply came {waited:.3f} s after its question; {allowed:.3f} s were allowed."
    return ServiceError("STALE", cause, hint="The planner or the network was held up: ask again.")


def _accepted(reply: zenoh.Reply) -> zenoh.Sample:
    """Return a reply's sample; raises the server's refusal, or NO_SERVICE when the reply is zenoh's own error."""
    if reply.ok is not None:
        return reply.ok
    failure = reply.err
    if failure is None:
        raise no_service("an empty reply")
    codec = error_codec(str(failure.encoding))
    if codec is None:
        raise no_service(f"an error of zenoh ({failure.payload.to_bytes()[:100].decode(errors='replace')})")
    try:
        refused = codec.decode(messages.ErrorAnswer, failure.payload.to_bytes())
    except ServiceError as error:
        raise no_service(f"an error that is not the service's ({error.message})") from error
    status = cast(FailureStatus, refused.status)
    raise ServiceError(status, refused.cause, hint=refused.next_step, request_id=refused.request_id)


def no_service(what: str = "", settings: ClientSettings | None = None) -> ServiceError:
    """Return the error of a query that no server answered, with what may be the matter.

    Zero replies without an error is all that zenoh shows, whatever the cause.

    Parameters
    ----------
    what : str
    settings : ClientSettings, optional
    """
    where = ""
    if settings is not None:
        address = settings.config_file or ", ".join(settings.endpoints)
        where = f" on {settings.namespace}/{settings.arm} at {address}"
    return ServiceError(
        "NO_SERVICE",
        f"no server answered{where}" + (f": got {what}." if what else "."),
        hint=(
            "Is the server running, with this arm, namespace and address? Other causes: access denied, "
            "a query larger than the server takes, a server that hangs."
        ),
    )


def _array(values: ArrayLike, what: str, ndim: int) -> FloatArray:
    try:
        numbers = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise bad_input(f"the {what} is not an array of numbers ({error}).") from error
    if numbers.ndim != ndim:
        raise bad_input(f"the {what} has {numbers.ndim} dimensions, {ndim} were expected.")
    return numbers
