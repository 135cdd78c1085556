"""zenoh's threads: forks, in which they are missing, and signals, which they may be handed; certificates."""

from __future__ import annotations

import ctypes
import datetime
import json
import os
import threading
from collections.abc import Callable
from pathlib import Path
from weakref import WeakSet

import zenoh

from gpcorrect.errors import DataError
from gpcorrect_service.protocol.errors import ServiceError

LOOK_UP = 1.0  # s, between looks whether a signal has come: a second is short for who stops a service


class _Process:
    """What this process, or the one that it was forked from, has done."""

    opened = False
    forked = False

    def __init__(self) -> None:
        self.holders: WeakSet[object] = WeakSet()

    def after_fork(self) -> None:
        self.forked = self.opened
        for holder in self.holders:
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(holder))


_PROCESS = _Process()
os.register_at_fork(after_in_child=_PROCESS.after_fork)


def immortal_in_children(holder: object) -> None:
    """Let a forked child never free what holds a session: freeing it, at the child's end too, waits in vain.

    Parameters
    ----------
    holder : object
    """
    _PROCESS.holders.add(holder)


def is_forked() -> bool:
    """Whether this process was forked from one that had opened a session."""
    return _PROCESS.forked


def require_own_process() -> None:
    """Refuse, as NO_SERVICE, to speak zenoh in a process that was forked from one that had opened a session."""
    if _PROCESS.forked:
        raise ServiceError(
            "NO_SERVICE",
            "this process was forked from one that had a connection already; zenoh does not work in it.",
            hint='Start processes with multiprocessing.get_context("spawn"), and open clients in them.',
        )


def open_zenoh(config: zenoh.Config) -> zenoh.Session:
    """Open a session; the only place that does. Raises as the two checks do, and ZError where it cannot be opened.

    Parameters
    ----------
    config : zenoh.Config
    """
    require_own_process()
    require_valid(config)
    _PROCESS.opened = True
    return zenoh.open(config)


def require_valid(config: zenoh.Config) -> None:
    """Raise ExpiredError unless every certificate of a configuration is valid now: zenoh would not say why it fails.

    Parameters
    ----------
    config : zenoh.Config
    """
    if json.loads(config.get_json("transport/link/tls")):
        check_certificates(config, datetime.datetime.now(datetime.UTC))


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


def check_certificates(config: zenoh.Config, now: datetime.datetime) -> datetime.datetime | None:
    """Return when the first certificate expires, None where there is none; what is no certificate is left to zenoh.

    Parameters
    ----------
    config : zenoh.Config
    now : datetime

    Raises
    ------
    ExpiredError
        One has expired, or is not valid yet.
    """
    from cryptography import x509  # slow to import, and seldom needed

    tls, ends = json.loads(config.get_json("transport/link/tls")) or {}, []
    for name in ("root_ca_certificate", "listen_certificate", "connect_certificate"):
        path = Path(tls.get(name) or "")
        if not path.is_file():
            continue
        try:
            certificate = x509.load_pem_x509_certificate(path.read_bytes())
        except (OSError, ValueError):
            continue
        begin, end = certificate.not_valid_before_utc, certificate.not_valid_after_utc
        if now > end:
            raise ExpiredError(
                f"certificate {path} expired on {end:%Y-%m-%d %H:%M} UTC; it is {now:%Y-%m-%d %H:%M} UTC here.",
                hint="Secure the site anew (gpcorrect secure init NEWFOLDER) and hand out its files.",
            )
        if now < begin:
            raise ExpiredError(
                f"certificate {path} is valid from {begin:%Y-%m-%d %H:%M} UTC on; it is {now:%Y-%m-%d %H:%M} UTC here.",
                hint="Set this machine's clock.",
            )
        ends.append(end)
    return min(ends, default=None)
