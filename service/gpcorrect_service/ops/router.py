"""A zenoh router in a process of its own: what `zenohd` is, for machines that have Python alone."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

import zenoh

from gpcorrect.errors import DataError
from gpcorrect_service.protocol.errors import EndpointError
from gpcorrect_service.protocol.process import open_zenoh
from gpcorrect_service.protocol.sessions import first_sentence, read_config

__all__ = ["route"]


def route(config_file: Path, stop: threading.Event, on_ready: Callable[[], None] | None = None) -> None:
    """Route until stopped.

    Parameters
    ----------
    config_file : path
        zenoh's, JSON5, with mode "router".
    stop : threading.Event
    on_ready : callable, optional
        Called once it routes.

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
    try:
        session = open_zenoh(config)
    except zenoh.ZError as error:
        raise EndpointError(
            str(config_file),
            f"the router cannot listen ({first_sentence(error)}).",
            hint="Another one may hold this address.",
        ) from error
    with session:
        if on_ready is not None:
            on_ready()
        stop.wait()
