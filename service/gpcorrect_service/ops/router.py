"""A zenoh router in a process of its own: what `zenohd` is, for machines that have Python alone."""

from __future__ import annotations

import os
import socket
import stat
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import zenoh

from gpcorrect.errors import DataError
from gpcorrect_service.ops.denials import denials_logged
from gpcorrect_service.ops.logger import Logger, open_logger
from gpcorrect_service.protocol.errors import EndpointError
from gpcorrect_service.protocol.process import open_zenoh, wait_for
from gpcorrect_service.protocol.sessions import first_sentence, read_config

SILENT_SECONDS = 60  # chosen by hand: as long as the kernel asks again (tcp_synack_retries); then it goes to zenoh


def route(
    config_file: Path, stop: threading.Event, on_ready: Callable[[], None] | None = None, logger: Logger | None = None
) -> None:
    """Route until stopped, and log who is denied what; for a process of its own, whose standard output is taken.

    Parameters
    ----------
    config_file : path
        zenoh's, JSON5, with mode "router".
    stop : threading.Event
    on_ready : callable, optional
        Called once it routes.
    logger : Logger, optional
        Standard error by default.

    Raises
    ------
    DataError
        The configuration cannot be read, or is not a router's.
    EndpointError
        The address is taken or cannot be used.
    """
    config = read_config(config_file)
    if config.get_json("mode") != '"router"':
        raise DataError(f"{config_file} is not a router's configuration.", hint='Its mode must be "router".')
    with denials_logged(logger or open_logger()):
        try:
            session = open_zenoh(config)
        except zenoh.ZError as error:
            raise EndpointError(
                str(config_file),
                f"the router cannot listen ({first_sentence(error)}).",
                hint="Another one may hold this address.",
            ) from error
        with session:
            _leave_silent_connections_to_the_kernel()
            if on_ready is not None:
                on_ready()
            wait_for(stop)


def _leave_silent_connections_to_the_kernel() -> None:
    """Let the listening sockets of this process accept a connection only once its first bytes are there.

    zenoh pauses for 0.1 s after each handshake that fails or takes too long, which is compiled in: some hundred
    connections that say nothing would keep everybody else waiting for a minute.
    """
    if not hasattr(socket, "TCP_DEFER_ACCEPT"):  # Linux has it
        return
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):  # closed meanwhile, or no TCP
            if stat.S_ISSOCK(os.fstat(int(name)).st_mode):
                with socket.socket(fileno=os.dup(int(name))) as one:
                    if one.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN):
                        one.setsockopt(socket.IPPROTO_TCP, socket.TCP_DEFER_ACCEPT, SILENT_SECONDS)
