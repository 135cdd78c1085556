"""Topics over zenoh: native keys for all, rmw_zenoh keys as well where ROS nodes listen."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import zenoh
from zenoh.ext import AdvancedPublisher, CacheConfig, declare_advanced_publisher

from gpcorrect.errors import DataError
from gpcorrect_service.crtk.messages import TF, TOPICS, Message, Topic, from_cdr, tf_cdr, to_cdr
from gpcorrect_service.protocol import sessions
from gpcorrect_service.protocol.errors import EndpointError, ServiceError, bad_input
from gpcorrect_service.protocol.limits import checked_stamp
from gpcorrect_service.protocol.messages import JSON, MSGPACK
from gpcorrect_service.protocol.ros import DEFAULT_QOS, GID_BYTES, LATCHED_QOS, RmwNode, attachment, rmw_key
from gpcorrect_service.protocol.settings import DEFAULT_NAMESPACE, RosDistro, check_loopback, refuse_two_places

CLAIM_SECONDS = 2.0  # chosen by hand: in which a router says who else there is; it answers at once

OWN_CDR = "application/cdr;gpcorrect"  # of what we send on keys of ROS, whose nodes look at no encoding

DEFAULT_ROBOT = "tcp/127.0.0.1:7448"  # on this machine only


@dataclass(frozen=True)
class BusSettings:
    """Where an arm's topics are.

    Parameters
    ----------
    endpoint : str, address to listen on, or to connect to
    arm, namespace : str, second and first part of every native key
    role : "hub" or "client"
        A hub listens and passes messages between its clients, as a router does; a client connects to it.
    ros_domain : int or None, ROS_DOMAIN_ID to speak in as well, on rmw_zenoh's keys; None for native keys alone
    ros_distro : str, ROS distribution of the nodes there
    allow_remote : bool, whether a hub may listen on an address that other machines reach
    patience : float, seconds in which a client waits for its hub to appear
    config_file : Path or None
        A zenoh JSON5 configuration that replaces `endpoint`, of a client; its `namespace`, where given, wins.
    """

    endpoint: str = DEFAULT_ROBOT
    arm: str = "arm1"
    namespace: str = DEFAULT_NAMESPACE
    role: Literal["hub", "client"] = "client"
    ros_domain: int | None = None
    ros_distro: RosDistro = "jazzy"
    allow_remote: bool = False
    patience: float = 5.0
    config_file: Path | None = None

    def __post_init__(self) -> None:
        refuse_two_places(self.config_file, given=self.endpoint != DEFAULT_ROBOT)

    @property
    def where(self) -> str:
        """What to call the place in messages: the configuration, or the address."""
        return str(self.config_file or self.endpoint)


Refused = Callable[[ServiceError], None]


class Bus(AbstractContextManager["Bus"]):
    """Publishes and subscribes an arm's topics; a context manager.

    Parameters
    ----------
    settings : BusSettings
    node : str, name in the ROS graph

    Raises
    ------
    EndpointError
        A hub cannot listen there, or nobody answers a client.
    DataError
        The configuration file cannot be read, or is not a client's.
    """

    def __init__(self, settings: BusSettings, node: str = "gpcorrect") -> None:
        self.settings = settings = in_namespace(settings)
        self._stack = ExitStack()
        self._session = self._stack.enter_context(open_session(settings))
        self._publishers: dict[str, list[Callable[[Message], None]]] = {}
        self._numbers = itertools.count(1)
        self._node: RmwNode | None = None
        if settings.ros_domain is not None:
            zid = str(self._session.info.zid())
            self._node = RmwNode(settings.ros_domain, zid, node, settings.ros_distro)
            self._stack.enter_context(self._session.liveliness().declare_token(self._node.node_token()))

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the session."""
        self._publishers.clear()
        self._stack.close()

    def key(self, name: str) -> str:
        """Return the native key of a topic.

        Parameters
        ----------
        name : str
        """
        return f"{self.settings.namespace}/{self.settings.arm}/{name}"

    def claim(self, role: str) -> None:
        """Be the only one of a role at this arm for as long as the session lasts; two at once both hear of each other.

        Parameters
        ----------
        role : str, behind the arm's name, such as "prefilter"; DataError where another process has it
        """
        live, own = self._session.liveliness(), self.key(f"{role}/{self._session.info.zid()}")
        self._stack.enter_context(live.declare_token(own))
        tokens = [reply.ok for reply in live.get(self.key(f"{role}/*"), timeout=CLAIM_SECONDS)]
        if any(token is not None and str(token.key_expr) != own for token in tokens):
            cause = f"another {role} is at work for {self.key('')[:-1]}: the robot would hear every command twice."
            hint = "Stop it first; one that was cut off from the network is forgotten after ten seconds."
            raise DataError(cause, hint=hint)

    def publish(self, name: str, message: Message) -> None:
        """Send a message; it is dropped where a listener cannot keep up.

        Parameters
        ----------
        name : str
        message : Struct
        """
        senders = self._publishers.get(name)
        if senders is None:
            senders = self._publishers[name] = self._senders(TOPICS[name])
        for send in senders:
            send(message)

    def subscribe(self, name: str, inbox: Callable[[Any], None], refused: Refused | None = None) -> None:
        """Receive every message of a topic, on zenoh's thread.

        Parameters
        ----------
        name : str
        inbox : callable, takes a message; must not wait
        refused : callable, optional, takes the error of a message that cannot be read
        """
        what = TOPICS[name]
        self._listen(self.key(name), what, inbox, refused)
        if self._node is not None and what.ros_type:
            self._listen(self._declare_ros(what, "MS")[0], what, inbox, refused)

    def _listen(self, key: str, what: Topic, inbox: Callable[[Any], None], refused: Refused | None) -> None:
        def _receive(sample: zenoh.Sample) -> None:
            if sample.encoding == OWN_CDR:  # on its native key it comes too
                return
            try:
                message = read_message(sample.payload.to_bytes(), str(sample.encoding), what)
            except ServiceError as error:
                if refused is not None:
                    refused(error)
                return
            inbox(message)

        callback = zenoh.handlers.Callback(_receive, indirect=False)
        self._stack.enter_context(self._session.declare_subscriber(key, callback))

    def _senders(self, what: Topic) -> list[Callable[[Message], None]]:
        """Return what sends a topic's messages: on its native key, and on those of ROS."""
        encoding = f"{MSGPACK.media_type};gpcorrect.{what.kind}/1"
        native = self._publisher(self.key(what.name), what)
        senders: list[Callable[[Message], None]] = [lambda m: native.put(MSGPACK.encode(m), encoding=encoding)]
        if self._node is None or not what.ros_type:
            return senders
        key, token = self._declare_ros(what, "MP")
        senders.append(_ros_sender(self._publisher(key, what, late=what.latched), token, to_cdr))
        if what.child:
            base, child = f"{self.settings.arm}_base", f"{self.settings.arm}_{what.child}"
            key, token = self._declare_ros(TF, "MP", "tf")
            senders.append(_ros_sender(self._publisher(key, TF), token, lambda m: tf_cdr(m, base, child)))
        return senders

    def _publisher(self, key: str, what: Topic, *, late: bool = False) -> zenoh.Publisher | AdvancedPublisher:
        """Return a publisher; a `late` one gives its last message to who comes late, as ROS calls "transient local"."""
        drop = zenoh.CongestionControl.DROP
        if late:
            cache = CacheConfig(max_samples=1)
            advanced = declare_advanced_publisher(
                self._session, key, congestion_control=drop, cache=cache, publisher_detection=True
            )
            return self._stack.enter_context(advanced)
        priority = zenoh.Priority.INTERACTIVE_HIGH if what.urgent else zenoh.Priority.DATA
        publisher = self._session.declare_publisher(key, congestion_control=drop, priority=priority, express=True)
        return self._stack.enter_context(publisher)

    def _declare_ros(self, what: Topic, kind: str, name: str = "") -> tuple[str, str]:
        """Show a topic in the ROS graph, under the arm's name or its own; return its key and its liveliness token."""
        assert self._node is not None
        name = name or f"{self.settings.arm}/{what.name}"
        qos = LATCHED_QOS if what.latched and kind == "MP" else DEFAULT_QOS
        token = self._node.topic_token(next(self._numbers), kind, name, what.ros_type, qos)
        self._stack.enter_context(self._session.liveliness().declare_token(token))
        return rmw_key(self._node.domain, name, what.ros_type, self._node.distro), token


def _ros_sender(
    publisher: zenoh.Publisher | AdvancedPublisher, token: str, encode: Callable[[Any], bytes]
) -> Callable[[Message], None]:
    """Return what sends messages on a ROS key, numbered, under the name that the publisher has there."""
    # Of a sender's name only that it differs from others' matters.
    numbers, gid = itertools.count(1), hashlib.blake2b(token.encode(), digest_size=GID_BYTES).digest()

    def _send(message: Message) -> None:
        beside = attachment(next(numbers), round(message.stamp * 1e9), gid)
        publisher.put(encode(message), encoding=OWN_CDR, attachment=beside)

    return _send


def read_message(payload: bytes, encoding: str, what: Topic) -> Any:
    """Read a topic's message in whatever encoding it came; bytes without a name are ROS's, text without one is JSON.

    Parameters
    ----------
    payload : bytes
    encoding : str, zenoh's; BAD_INPUT for another one, and where the bytes are no such message, or none of a time
    what : Topic
    """
    message: Any
    if encoding.startswith(MSGPACK.media_type):
        message = MSGPACK.decode(what.form, payload)
    elif encoding.startswith((JSON.media_type, "text/")):
        message = JSON.decode(what.form, payload)
    elif what.ros_type and encoding.startswith(("application/cdr", "zenoh/bytes")):
        message = from_cdr(payload, what.ros_type)
    else:
        raise bad_input(f"{what.name} does not come as {encoding}.", "Send msgpack, JSON or CDR.")
    if message.stamp:  # 0 is no time, which people leave out; no other stamp goes on that cannot be sent or written
        checked_stamp(message.stamp)
    return message


def open_session(settings: BusSettings) -> zenoh.Session:
    """Open a hub's or a client's session, without a namespace.

    Parameters
    ----------
    settings : BusSettings

    Raises
    ------
    EndpointError
        A hub cannot listen there; or nobody answers a client.
    DataError
        The configuration file cannot be read, or is not a client's.
    """
    hub = settings.role == "hub"
    if hub:
        check_loopback(settings.endpoint, allow_remote=settings.allow_remote)
    config = _config(settings)
    config.insert_json5("connect/timeout_ms", json.dumps(round(1000 * settings.patience)))
    what = "cannot listen here" if hub else "nobody answers here"
    hint = "Another program may hold this address." if hub else "Start the arm first: gpcorrect sim serve"
    if settings.config_file is not None:
        hint = f"Why: gpcorrect doctor --config {settings.config_file}"
    return sessions.open_zenoh(config, lambda said: EndpointError(settings.where, f"{what} ({said}).", hint=hint))


def check_place(settings: BusSettings) -> None:
    """Raise the DataError that :func:`open_session` would raise however often it is tried: of file and certificates.

    Parameters
    ----------
    settings : BusSettings
    """
    sessions.check_certificates(_config(settings))


def _config(settings: BusSettings) -> zenoh.Config:
    """Return a hub's or a client's configuration; keys are written with the namespace here, so zenoh adds none."""
    hub = settings.role == "hub"
    if settings.config_file is None:
        return sessions.make_config(
            {
                **sessions.COMMON,
                "mode": "router" if hub else "client",
                "listen/endpoints": [settings.endpoint] if hub else [],
                "connect/endpoints": [] if hub else [settings.endpoint],
                "connect/retry": {"period_init_ms": 50, "period_max_ms": 500, "period_increase_factor": 2},
            }
        )
    config = sessions.read_config(settings.config_file)
    if config.get_json("mode") != '"client"':
        raise DataError(f"{settings.config_file} is not a client's configuration.", hint='Its mode must be "client".')
    config.insert_json5("namespace", "null")
    config.insert_json5("connect/exit_on_failure", "true")
    return config


def in_namespace(settings: BusSettings) -> BusSettings:
    """Return the settings with the namespace that their configuration file names; DataError where it cannot be read.

    Parameters
    ----------
    settings : BusSettings
    """
    if settings.config_file is None:
        return settings
    config = sessions.read_config(settings.config_file)
    return replace(settings, namespace=sessions.namespace_of(config, settings.namespace))
