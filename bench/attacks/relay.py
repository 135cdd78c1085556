"""A network between two processes that can stand still: nothing is lost in it, everything comes late."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

PIECE = 65536  # bytes


@contextmanager
def relay(endpoint: str) -> Iterator[tuple[str, threading.Event]]:
    """Pass on what comes for an address; gives the relay's own address, and an event that is set while it flows.

    Parameters
    ----------
    endpoint : str, as `tcp/127.0.0.1:7448`
    """
    host, port = endpoint.removeprefix("tcp/").split(":")
    flows, links = threading.Event(), []
    flows.set()

    def _pass(source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while piece := source.recv(PIECE):
                flows.wait()
                sink.sendall(piece)

    def _accept(listening: socket.socket) -> None:
        with suppress(OSError):
            while True:
                near, _ = listening.accept()
                far = socket.create_connection((host, int(port)))
                links.extend((near, far))
                for pair in ((near, far), (far, near)):
                    threading.Thread(target=_pass, args=pair, daemon=True).start()

    with socket.create_server(("127.0.0.1", 0)) as listening:
        threading.Thread(target=_accept, args=(listening,), daemon=True).start()
        try:
            yield f"tcp/127.0.0.1:{listening.getsockname()[1]}", flows
        finally:
            flows.set()
            for link in links:
                link.close()
