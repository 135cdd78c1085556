"""Where a server listens and what a client asks: settings, checked once."""

from __future__ import annotations

import ipaddress
import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from gpcorrect.errors import DataError
from gpcorrect_service.protocol.bounds import CorrectionBound
from gpcorrect_service.protocol.errors import EndpointError
from gpcorrect_service.protocol.messages import Kind

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7449"  # on this machine only; 7447 is that of ROS 2's router, rmw_zenohd
DEFAULT_NAMESPACE = "gpcorrect"  # the package's name, which nobody else takes
MAX_MESSAGE_BYTES = 4 * 1024 * 1024  # holds the longest path in JSON; what is larger is no query of ours

OnFailure = Literal["raise", "identity"]
RosDistro = Literal["humble", "jazzy", "rolling"]
"""Who listens: Humble has no type hashes, and its keys end otherwise than those of Jazzy, Kilted and Rolling."""

# zenoh gives a meaning to * $ # ? and hides chunks that begin with @ from wildcards.
CHUNK = re.compile(r"[A-Za-z0-9_.-]+")
ENDPOINT = re.compile(
    r"(?P<protocol>[a-z0-9_-]+)/(?P<host>\[[0-9a-fA-F:.]+\]|[^/:\[\]]+):(?P<port>\d{1,5})(?P<options>[?#].*)?"
)


@dataclass(frozen=True)
class ServerSettings:
    """How one server process serves one arm.

    Parameters
    ----------
    endpoint : str, address to listen on
    arm : str, CRTK name of the arm, the second part of every key
    namespace : str, zenoh namespace, the first part of every key
    queue_capacity : int, requests that may wait for a worker; the next one is answered BUSY
    drain_seconds : float, how long stopping waits for the requests that are queued
    replica : str, name of this process in replies; empty makes it from host and process number
    allow_remote : bool, whether an address other than loopback may be listened on
    config_file : Path or None
        A zenoh JSON5 configuration instead of `endpoint`; its `namespace`, where given, wins over the default.
    bound : CorrectionBound, what no correction may exceed; the model's own bounds hold as well
    max_rate : float, corrections a second that are answered; the others hear BUSY
    robot : str, address of the robot whose joints are estimated, which may come later; empty for one that connects
    stream_key : str, the robot's joints come under this key of the arm
    stream_max_age : float, seconds after which an estimate of the stream is called STALE
    stream_rate : float, largest change of a streamed joint correction, rad/s and m/s
    strict : bool, whether what lies outside the training region is refused instead of answered as EXTRAPOLATING
    frame : str, name of the frame that ROS poses come in; empty for the model's own name of it
    metrics_port : int or None, port of 127.0.0.1 where Prometheus finds `/metrics`; None for none
    ros_domain : int or None
        ROS_DOMAIN_ID in which `correct` is a ROS 2 service too, on rmw_zenoh's keys; None for no ROS.
    ros_distro : str, ROS distribution of the nodes there
    """

    endpoint: str = DEFAULT_ENDPOINT
    arm: str = "arm1"
    namespace: str = DEFAULT_NAMESPACE
    queue_capacity: int = 64
    drain_seconds: float = 1.5
    replica: str = ""
    allow_remote: bool = False
    config_file: Path | None = None
    bound: CorrectionBound = field(default_factory=CorrectionBound)
    max_rate: float = math.inf
    robot: str = ""
    stream_key: str = "measured_js"
    stream_max_age: float = 0.05
    stream_rate: float = math.inf
    strict: bool = False
    frame: str = ""
    metrics_port: int | None = None
    ros_domain: int | None = None
    ros_distro: RosDistro = "jazzy"

    @property
    def bounds(self) -> str:
        """The operator's bounds on single answers, in words; empty for none."""
        most = ((1e3 * self.bound.position, "mm"), (math.degrees(self.bound.rotation), "deg"))
        words = [f"{value:.6g} {unit}" for value, unit in most if math.isfinite(value)]
        return ", ".join([*words, *(["strict"] if self.strict else [])])

    def __post_init__(self) -> None:
        _check_names(self.arm, self.namespace)
        for name in ("max_rate", "stream_max_age", "stream_rate"):
            _at_least(name, getattr(self, name), 1e-6)
        _at_least("queue_capacity", self.queue_capacity, 1)
        _at_least("drain_seconds", self.drain_seconds, 0)
        refuse_two_places(self.config_file, given=bool(self.robot) or self.endpoint != DEFAULT_ENDPOINT)
        if self.config_file is None:
            for endpoint in (self.endpoint, *([self.robot] if self.robot else [])):
                _parse_endpoint(endpoint)
            check_loopback(self.endpoint, allow_remote=self.allow_remote)


@dataclass(frozen=True)
class ClientSettings:
    """Whom a planner asks, and how long it waits.

    Parameters
    ----------
    endpoints : tuple of str, addresses of the servers; all of them are connected to
    arm, namespace : str, as in :class:`ServerSettings`
    timeout : float, seconds for one `correct`, `model` or `health`, its one retry included
    path_timeout : float, the same for `correct_path`
    connect_timeout : float, seconds to wait for a server to appear, before the first query only
    config_file : Path or None, a zenoh JSON5 configuration instead of `endpoints` (through a router: mode "client")
    """

    endpoints: tuple[str, ...] = (DEFAULT_ENDPOINT,)
    arm: str = "arm1"
    namespace: str = DEFAULT_NAMESPACE
    timeout: float = 0.5
    path_timeout: float = 10.0
    connect_timeout: float = 3.0
    config_file: Path | None = None

    def timeout_of(self, kind: Kind) -> float:
        """Return the seconds for one answer of a key.

        Parameters
        ----------
        kind : str
        """
        return self.path_timeout if kind in ("correct_path", "correct_joints") else self.timeout

    def __post_init__(self) -> None:
        _check_names(self.arm, self.namespace)
        for name in ("timeout", "path_timeout", "connect_timeout"):
            _at_least(name, getattr(self, name), 0.001)
        refuse_two_places(self.config_file, given=self.endpoints != (DEFAULT_ENDPOINT,))
        if self.config_file is None:
            for endpoint in self.endpoints:
                _parse_endpoint(endpoint)


def refuse_two_places(config_file: Path | None, *, given: bool) -> None:
    """Refuse, with a DataError, an address beside a configuration, which names one too: only one would be followed.

    Parameters
    ----------
    config_file : Path or None
    given : bool, whether an address was given, other than the default
    """
    if config_file is not None and given:
        raise DataError(f"an address and {config_file} both say where to go.", hint="Give one of them.")


def check_loopback(endpoint: str, *, allow_remote: bool) -> None:
    """Refuse, with an EndpointError, an address that other machines can reach, unless that was asked for.

    Pipes and Unix sockets stay at home.

    Parameters
    ----------
    endpoint : str
    allow_remote : bool
    """
    if endpoint.startswith(("unixsock-stream/", "unixpipe/")):
        return
    host = _parse_endpoint(endpoint)["host"].strip("[]")
    if allow_remote or host == "localhost":
        return
    try:
        loopback = ipaddress.ip_address(host).is_loopback
    except ValueError:
        loopback = False
    if not loopback:
        cause = "this address can be reached from other machines, and nothing would ask them who they are."
        hint = "Listen on 127.0.0.1, or allow remote access on purpose, behind access control."
        raise EndpointError(endpoint, cause, hint=hint)


def _parse_endpoint(endpoint: str) -> dict[str, str]:
    match = ENDPOINT.fullmatch(endpoint)
    if match is None or not int(match["port"]) < 65536:
        hint = "Write protocol/host:port, as tcp/127.0.0.1:7449."
        raise EndpointError(endpoint, "this is not an address.", hint=hint)
    return match.groupdict()


def _check_names(arm: str, namespace: str) -> None:
    for what, text in (("arm", arm), *(("namespace", chunk) for chunk in namespace.split("/"))):
        if not CHUNK.fullmatch(text):
            hint = "Use letters, digits, underscore, dot and hyphen."
            raise DataError(f"{what} name {text!r} cannot be part of a key.", hint=hint)


def _at_least(name: str, value: float, least: float) -> None:
    if not value >= least:
        raise DataError(f"{name} must be at least {least}, got {value}.")
