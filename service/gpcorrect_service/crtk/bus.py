"""Topics over zenoh: native keys for all, rmw_zenoh keys as well where ROS nodes listen."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Literal, Self

import msgspec
import zenoh

from gpcorrect_service.crtk.messages import TOPICS, Message, Topic
from gpcorrect_service.crtk.rmw import RmwNode, attachment, gid_of, rmw_key
from gpcorrect_service.crtk.ros_messages import from_cdr, to_cdr
from gpcorrect_service.protocol.errors import EndpointError, ServiceError
from gpcorrect_service.protocol.sessions import COMMON
from gpcorrect_service.protocol.settings import check_loopback

__all__ = ["Bus", "BusSettings", "Inbox", "open_session", "read_message"]

MSGPACK, JSON, CDR = "application/msgpack", "application/json", "application/cdr"
RETRY = {"period_init_ms": 50, "period_max_ms": 500, "period_increase_factor": 2}


@dataclass(frozen=True)
class BusSettings:
    """Where an arm's topics are.

    Parameters
    ----------
    endpoint : str
        Address to listen on, or to connect to.
    arm, namespace : str
        Second and first part of every native key.
    role : "hub" or "client"
        A hub listens and passes messages between its clients, as a router does; a client connects to it.
    ros_domain : int or None
        ROS_DOMAIN_ID to speak in as well, on rmw_zenoh's keys; None for native keys alone.
    allow_remote : bool
        Whether a hub may listen on an address that other machines reach.
    patience : float
        Seconds in which a client waits for its hub to appear.
    """

    endpoint: str = "tcp/127.0.0.1:7448"
    arm: str = "arm1"
    namespace: str = "gpcorrect"
    role: Literal["hub", "client"] = "client"
    ros_domain: int | None = None
    allow_remote: bool = False
    patience: float = 5.0


Inbox = Callable[[Any], None]
Refused = Callable[[ServiceError], None]


class Bus:
    """Publishes and subscribes an arm's topics; a context manager.

    Parameters
    ----------
    settings : BusSettings
    node : str
        Name in the ROS graph.

    Raises
    ------
    EndpointError
        A hub cannot listen there.
    """

    def __init__(self, settings: BusSettings, node: str = "gpcorrect") -> None:
        self.settings = settings
        self._stack = ExitStack()
        self._session = self._stack.enter_context(open_session(settings))
        self._publishers: dict[str, _Sender] = {}
        self._numbers = itertools.count(1)
        self._node: RmwNode | None = None
        if settings.ros_domain is not None:
            self._node = RmwNode(settings.ros_domain, str(self._session.info.zid()), node)
            self._token(self._node.node_token())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the session."""
        self._publishers.clear()
        self._stack.close()

    @property
    def session(self) -> zenoh.Session:
        """The zenoh session, without a namespace."""
        return self._session

    def key(self, name: str) -> str:
        """Return the native key of a topic."""
        return f"{self.settings.namespace}/{self.settings.arm}/{name}"

    def publish(self, name: str, message: Message) -> None:
        """Send a message; it is dropped where a listener cannot keep up."""
        sender = self._publishers.get(name)
        if sender is None:
            sender = self._publishers[name] = self._sender(TOPICS[name])
        sender.send(message)

    def subscribe(self, name: str, inbox: Inbox, refused: Refused | None = None) -> None:
        """Hand every message of a topic to `inbox`, on zenoh's thread: it must not wait.

        What cannot be read goes to `refused`.
        """
        what = TOPICS[name]
        self._listen(self.key(name), what, inbox, refused)
        if self._node is not None and what.ros_type:
            self._listen(rmw_key(self._node.domain, self._ros_name(name), what.ros_type), what, inbox, refused)
            number = next(self._numbers)
            self._token(self._node.topic_token(number, "MS", self._ros_name(name), what.ros_type))

    def _listen(self, key: str, what: Topic, inbox: Inbox, refused: Refused | None) -> None:
        def receive(sample: zenoh.Sample) -> None:
            try:
                message = read_message(sample.payload.to_bytes(), str(sample.encoding), what)
            except ServiceError as error:
                if refused is not None:
                    refused(error)
                return
            inbox(message)

        callback = zenoh.handlers.Callback(receive, indirect=False)
        self._stack.enter_context(self._session.declare_subscriber(key, callback))

    def _sender(self, what: Topic) -> _Sender:
        native = self._declare(self.key(what.name))
        if self._node is None or not what.ros_type:
            return _Sender(native, what, None, b"")
        ros = self._declare(rmw_key(self._node.domain, self._ros_name(what.name), what.ros_type))
        token = self._node.topic_token(next(self._numbers), "MP", self._ros_name(what.name), what.ros_type)
        self._token(token)
        return _Sender(native, what, ros, gid_of(token))

    def _declare(self, key: str) -> zenoh.Publisher:
        return self._stack.enter_context(
            self._session.declare_publisher(key, congestion_control=zenoh.CongestionControl.DROP, express=True)
        )

    def _ros_name(self, name: str) -> str:
        return f"{self.settings.arm}/{name}"

    def _token(self, key: str) -> None:
        self._stack.enter_context(self._session.liveliness().declare_token(key))


class _Sender:
    """One topic's publishers."""

    def __init__(self, native: zenoh.Publisher, what: Topic, ros: zenoh.Publisher | None, gid: bytes) -> None:
        self._native, self._ros, self._gid = native, ros, gid
        self._encoding = f"{MSGPACK};gpcorrect.{what.kind}/1"
        self._encode = msgspec.msgpack.Encoder().encode
        self._count = 0

    def send(self, message: Message) -> None:
        self._native.put(self._encode(message), encoding=self._encoding)
        if self._ros is not None:
            self._count += 1
            beside = attachment(self._count, round(message.stamp * 1e9), self._gid)
            self._ros.put(to_cdr(message), attachment=beside)


def read_message(payload: bytes, encoding: str, what: Topic) -> msgspec.Struct:
    """Read a topic's message in whatever encoding it came; bytes without a name are ROS's, text without one is JSON.

    Raises
    ------
    ServiceError
        BAD_INPUT: it is no such message.
    """
    try:
        if encoding.startswith(MSGPACK):
            return msgspec.msgpack.decode(payload, type=what.form)
        if encoding.startswith((JSON, "text/")):
            return msgspec.json.decode(payload, type=what.form)
        if what.ros_type and encoding.startswith((CDR, "zenoh/bytes")):
            return from_cdr(payload, what.ros_type)
    except msgspec.DecodeError as error:
        raise ServiceError("BAD_INPUT", f"{what.name}: {error}") from error
    raise ServiceError("BAD_INPUT", f"{what.name} does not come as {encoding}.", hint="Send msgpack, JSON or CDR.")


def open_session(settings: BusSettings) -> zenoh.Session:
    """Open a hub's or a client's session, without a namespace.

    Raises
    ------
    EndpointError
        A hub cannot listen there; or nobody answers a client.
    """
    config = zenoh.Config()
    hub = settings.role == "hub"
    if hub:
        check_loopback(settings.endpoint, allow_remote=settings.allow_remote)
    values = {
        **COMMON,
        "mode": "router" if hub else "client",
        "listen/endpoints": [settings.endpoint] if hub else [],
        "connect/endpoints": [] if hub else [settings.endpoint],
        "connect/timeout_ms": round(1000 * settings.patience),
        "connect/retry": RETRY,
    }
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        cause = str(error).split(" at /", maxsplit=1)[0].strip()
        what = "cannot listen here" if hub else "nobody answers here"
        hint = "Another program may hold this address." if hub else "Start the arm first: gpcorrect sim serve"
        raise EndpointError(settings.endpoint, f"{what} ({cause}).", hint=hint) from error
