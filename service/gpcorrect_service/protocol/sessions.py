"""The zenoh sessions of server and client: loopback, no scouting, small messages; who lives; forks and signals."""

from __future__ import annotations

import ctypes
import datetime
import json
import os
import threading
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any
from weakref import WeakSet

import zenoh

from gpcorrect.errors import DataError, GpCorrectError
from gpcorrect_service.protocol.errors import EndpointError, ServiceError
from gpcorrect_service.protocol.settings import (
    DEFAULT_NAMESPACE,
    MAX_MESSAGE_BYTES,
    ClientSettings,
    ServerSettings,
    check_loopback,
)

LOOK_UP = 1.0  # s, between looks whether a signal has come: a second is short for who stops a service
COMMON: dict[str, Any] = {
    "mode": "peer",
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "transport/link/rx/max_message_size": MAX_MESSAGE_BYTES,
    # Queries and replies of a few kilobytes gain nothing from shared memory that ties two processes together.
    "transport/shared_memory/transport_optimization/messages": ["put"],
    # A client that stopped reading holds a worker for this long (microseconds) before its link is closed.
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 500_000,
}
CLIENT: dict[str, Any] = {
    "listen/endpoints": [],
    "connect/exit_on_failure": False,
    "connect/retry": {"period_init_ms": 50, "period_max_ms": 1000, "period_increase_factor": 2},
    # Opening returns at once; the client itself waits until a queryable matches.
    "open/return_conditions": {"connect_scouted": False, "declares": False},
}

LIVE_KEYS = "live/**"  # of an arm: the tokens of its servers, as `live_key` makes them
PREFILTER = "prefilter"  # of an arm: the tokens of those that correct its commands, of whom there is one


class _Process:
    """What this process, or the one that it was forked from, has done."""

    opened = False  # a session
    forked = False  # from one that had opened a session

    def __init__(self) -> None:
        # Whatever holds a session. A forked child never frees it: that, at the child's end too, waits in vain.
        self.holders: WeakSet[object] = WeakSet()

    def after_fork(self) -> None:
        self.forked = self.opened
        for holder in self.holders:
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(holder))


PROCESS = _Process()
os.register_at_fork(after_in_child=PROCESS.after_fork)


def require_own_process() -> None:
    """Refuse, as NO_SERVICE, to speak zenoh in a process that was forked from one that had opened a session."""
    if PROCESS.forked:
        cause = "this process was forked from one that had a connection already; zenoh does not work in it."
        hint = 'Start processes with multiprocessing.get_context("spawn"), and open clients in them.'
        raise ServiceError("NO_SERVICE", cause, hint=hint)


def open_zenoh(config: zenoh.Config, failed: Callable[[str], GpCorrectError]) -> zenoh.Session:
    """Open a session; the only place that does. Raises as the two checks do.

    An expired certificate is looked for first: zenoh would not say why it fails.

    Parameters
    ----------
    config : zenoh.Config
    failed : callable, makes the error to raise of what zenoh says where it cannot be opened
    """
    require_own_process()
    check_certificates(config)
    PROCESS.opened = True
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise failed(_first_sentence(error)) from error


def wait_for(stop: threading.Event, look: Callable[[], None] = lambda: None) -> None:
    """Wait in the main thread until an event is set, by a signal for one.

    The system may hand a signal to a thread of zenoh's; that wakes nobody, and Python runs the handler only when the
    main thread looks up.

    Parameters
    ----------
    stop : threading.Event
    look : callable, optional, called every second meanwhile
    """
    while not stop.wait(LOOK_UP):
        look()


class ExpiredError(DataError):
    """A certificate is not valid now."""


def check_certificates(config: zenoh.Config) -> datetime.datetime | None:
    """Return when the first certificate expires, None without one; ExpiredError where one has, or is not valid yet.

    What is no certificate is left to zenoh.

    Parameters
    ----------
    config : zenoh.Config
    """
    tls, ends = json.loads(config.get_json("transport/link/tls")) or {}, []
    now = datetime.datetime.now(datetime.UTC)
    for name in ("root_ca_certificate", "listen_certificate", "connect_certificate"):
        path = Path(tls.get(name) or "")
        if not path.is_file():
            continue
        from cryptography import x509  # slow to import, and seldom needed

        try:
            certificate = x509.load_pem_x509_certificate(path.read_bytes())
        except (OSError, ValueError):
            continue
        begin, end = certificate.not_valid_before_utc, certificate.not_valid_after_utc
        if now > end:
            cause = f"certificate {path} expired on {end:%Y-%m-%d %H:%M} UTC; it is {now:%Y-%m-%d %H:%M} UTC here."
            hint = "Secure the site anew (gpcorrect secure init NEWFOLDER) and hand out its files."
            raise ExpiredError(cause, hint=hint)
        if now < begin:
            raise ExpiredError(
                f"certificate {path} is valid from {begin:%Y-%m-%d %H:%M} UTC on; it is {now:%Y-%m-%d %H:%M} UTC here.",
                hint="Set this machine's clock.",
            )
        ends.append(end)
    return min(ends, default=None)


def open_server(settings: ServerSettings) -> zenoh.Session:
    """Open the session that a server listens with.

    Parameters
    ----------
    settings : ServerSettings

    Raises
    ------
    EndpointError
        The address is taken, cannot be bound, or can be reached from other machines without leave.
    DataError
        The configuration file cannot be read.
    """
    config = server_config(settings)
    where = ", ".join(listen_endpoints(config)) or str(settings.config_file or settings.endpoint)
    hint = "Another server may hold this address: stop it, or choose another endpoint."
    return open_zenoh(config, lambda said: EndpointError(where, f"cannot listen here ({said}).", hint=hint))


def server_config(settings: ServerSettings) -> zenoh.Config:
    """Return the zenoh configuration of a server; raises as :func:`open_server`.

    Parameters
    ----------
    settings : ServerSettings
    """
    robot = {**CLIENT, "connect/endpoints": [settings.robot]} if settings.robot else {}
    config = _config(settings.config_file, {**robot, "listen/endpoints": [settings.endpoint]}, settings.namespace)
    for endpoint in listen_endpoints(config):
        check_loopback(endpoint, allow_remote=settings.allow_remote)
    return config


def open_client(settings: ClientSettings) -> zenoh.Session:
    """Open the session that a planner asks with; servers may come later.

    Parameters
    ----------
    settings : ClientSettings

    Raises
    ------
    ServiceError
        NO_SERVICE: the configuration demands a connection at once and there is none.
    DataError
        The configuration file cannot be read.
    """
    hint = "Start the router or server that the configuration names."
    config = client_config(settings)
    return open_zenoh(config, lambda said: ServiceError("NO_SERVICE", f"zenoh cannot connect ({said}).", hint=hint))


def client_config(settings: ClientSettings) -> zenoh.Config:
    """Return the zenoh configuration of a client; DataError where its file cannot be read.

    Parameters
    ----------
    settings : ClientSettings
    """
    return _config(settings.config_file, {**CLIENT, "connect/endpoints": list(settings.endpoints)}, settings.namespace)


def _config(file: Path | None, own: dict[str, Any], namespace: str) -> zenoh.Config:
    """Return the configuration of a file, else the common one with what is `own` to a role; with its namespace."""
    config = make_config({**COMMON, **own}) if file is None else read_config(file)
    config.insert_json5("namespace", json.dumps(namespace_of(config, namespace)))
    return config


def make_config(values: dict[str, Any]) -> zenoh.Config:
    """Return a zenoh configuration.

    Parameters
    ----------
    values : dict, from zenoh's paths, as `listen/endpoints`, to what JSON can say
    """
    config = zenoh.Config()
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return config


def read_config(path: Path) -> zenoh.Config:
    """Read a zenoh configuration; DataError where it is not there, or not one.

    Parameters
    ----------
    path : path, JSON5
    """
    try:
        return zenoh.Config.from_file(path)
    except zenoh.ZError as error:
        hint = "Start from those in service/deploy."
        raise DataError(f"zenoh configuration {path} cannot be read ({_first_sentence(error)}).", hint=hint) from error


def namespace_of(config: zenoh.Config, given: str) -> str:
    """Return the namespace that a configuration names, else the one that is given, by the user or as the default.

    Parameters
    ----------
    config : zenoh.Config
    given : str

    Raises
    ------
    DataError
        Both name one, and another: whoever gave it means another robot than would move.
    """
    named = json.loads(config.get_json("namespace"))
    if named is None:
        return given
    if given not in (named, DEFAULT_NAMESPACE):
        hint = "Give the one or the other."
        raise DataError(f"the configuration is of namespace {named!r}, not of {given!r}.", hint=hint)
    return str(named)


def listen_endpoints(config: zenoh.Config) -> list[str]:
    """Return the addresses that a configuration listens on, which are a list, or one list a mode.

    Parameters
    ----------
    config : zenoh.Config
    """
    endpoints = json.loads(config.get_json("listen/endpoints"))
    if isinstance(endpoints, dict):
        mode = json.loads(config.get_json("mode")) or "peer"
        endpoints = endpoints.get(mode, [])
    return [str(endpoint) for endpoint in ([endpoints] if isinstance(endpoints, str) else endpoints)]


def _first_sentence(error: zenoh.ZError) -> str:
    """Return what zenoh says without the place in its sources."""
    return str(error).split(" at /", maxsplit=1)[0].strip()


def live_key(arm: str, replica: str, pose_hash: str, joint_hash: str) -> str:
    """Return the key of a server's token: `<arm>/live/<replica>/<hash of poses>/<hash of joints>`.

    Parameters
    ----------
    arm, replica : str
    pose_hash, joint_hash : str, SHA-256 of the models; empty for none
    """
    return f"{arm}/live/{replica}/{pose_hash or 'none'}/{joint_hash or 'none'}"


def differing(keys: Iterable[str]) -> dict[str, list[str]]:
    """Return, of each task in which the servers of an arm hold different models, who holds which.

    Parameters
    ----------
    keys : iterable of str, tokens of one arm
    """
    parts = [key.split("/")[-3:] for key in keys]
    found = {}
    for column, task in ((1, "poses"), (2, "joints")):
        if len({part[column] for part in parts}) > 1:
            found[task] = [f"{part[0]} has {part[column][:12]}" for part in sorted(parts)]
    return found
