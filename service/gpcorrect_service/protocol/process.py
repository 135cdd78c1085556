"""zenoh's threads: forks, in which they are missing, and signals, which they may be handed."""

from __future__ import annotations

import ctypes
import datetime
import json
import os
import threading
from collections.abc import Callable
from weakref import WeakSet

import zenoh

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
    """Refuse to speak zenoh in a process that cannot.

    Raises
    ------
    ServiceError
        NO_SERVICE: this process was forked from one that had opened a session.
    """
    if _PROCESS.forked:
        raise ServiceError(
            "NO_SERVICE",
            "this process was forked from one that had a connection already; zenoh does not work in it.",
            hint='Start processes with multiprocessing.get_context("spawn"), and open clients in them.',
        )


def open_zenoh(config: zenoh.Config) -> zenoh.Session:
    """Open a session; the only place that does.

    Parameters
    ----------
    config : zenoh.Config

    Raises
    ------
    ServiceError
        As :func:`require_own_process`.
    ExpiredError
        A certificate is not valid now: zenoh would try again and again, and not say why.
    zenoh.ZError
        It cannot be opened.
    """
    require_own_process()
    require_valid(config)
    _PROCESS.opened = True
    return zenoh.open(config)


def require_valid(config: zenoh.Config) -> None:
    """Raise unless every certificate of a configuration is valid now.

    Parameters
    ----------
    config : zenoh.Config

    Raises
    ------
    ExpiredError
        One is not.
    """
    if json.loads(config.get_json("transport/link/tls")):
        from gpcorrect_service.protocol.certificates import check_certificates  # slow to import, and seldom needed

        check_certificates(config, datetime.datetime.now(datetime.UTC))


def wait_for(stop: threading.Event, look: Callable[[], None] = lambda: None) -> None:
    """Wait in the main thread until an event is set, by a signal for one.

    The system may hand a signal to a thread of zenoh's; that wakes nobody, and Python runs the handler only when the
    main thread looks up.

    Parameters
    ----------
    stop : threading.Event
    look : callable, optional
        Called every second meanwhile.
    """
    while not stop.wait(LOOK_UP):
        look()
