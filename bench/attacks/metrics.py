"""The metrics port of a server: taken already, asked by garbage, by silent connections, under foreign names."""

from __future__ import annotations

import socket
import struct
import urllib.error
import urllib.request
from contextlib import ExitStack, suppress

import numpy as np
from service_bench import PATIENT, free_endpoint

from attacks.lab import Lab, Scenario, Seen
from attacks.programs import refused
from gpcorrect.calibration import load
from gpcorrect_service import CorrectionClient, ServiceError

SILENT, ROUNDS = 500, 40
GARBAGE = (
    b"\x00" * 300 + b"\r\n\r\n",
    b"GET " + b"a" * 70_000 + b"\r\n\r\n",
    b"\x16\x03\x01\x02\x00\x01\x00",
    b"GET /metrics?name[]=%ff&name[]=x HTTP/1.1\r\nHost: localhost\r\n\r\n",
    b"GET /metrics HTTP/9.9\r\n\r\n",
    b"POST /metrics HTTP/1.1\r\nContent-Length: -1\r\n\r\n",
    b"GET /metrics HTTP/1.1\r\nHost: localhost\r\n" + b"X: y\r\n" * 2000 + b"\r\n",
    b"GET /metrics HTTP/1.1\r\nHost: \xff\xfe[::1\r\nAccept: \xff;q=nan\r\n\r\n",
)


def metrics_port(lab: Lab) -> Seen:
    """Ask for corrections and metrics while the port is attacked; each is answered, no other name, and no traceback."""
    pose, end, port = load(lab.model).check_queries[0, :7], free_endpoint(), int(free_endpoint().rsplit(":", 1)[1])
    words, rng, wrong = ("--metrics-port", str(port)), np.random.default_rng(0), 0
    with (
        lab.program("serve", str(lab.model), "--endpoint", end, *words, ready="serving") as server,
        CorrectionClient(end, timeout=2.0, connect_timeout=PATIENT) as client,
        ExitStack() as silent,
    ):
        for _ in range(SILENT):
            silent.enter_context(socket.create_connection(("127.0.0.1", port), PATIENT))
        for number in range(ROUNDS):
            payload = GARBAGE[number % len(GARBAGE)] if number < ROUNDS // 2 else rng.bytes(rng.integers(1, 2000))
            with suppress(OSError), socket.create_connection(("127.0.0.1", port), PATIENT) as link:
                link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                link.sendall(payload)
            wrong += not _scraped(port, "localhost") or _scraped(port, "lab.example")
            try:
                client.correct(pose)
            except ServiceError:
                wrong += 1
        wrong += not refused(["serve", str(lab.model), "--endpoint", free_endpoint(), *words])
        wrong += "Traceback" in server.log
    return Seen(2 * ROUNDS + 2, wrong, f"{SILENT} silent connections meanwhile")


def _scraped(port: int, name: str) -> bool:
    """Whether metrics come under a name, within two seconds."""
    request = urllib.request.Request(f"http://127.0.0.1:{port}/metrics", headers={"Host": name})
    try:
        with urllib.request.urlopen(request, timeout=2.0) as reply:
            return b"gpcorrect_state" in reply.read()
    except (OSError, urllib.error.URLError):
        return False


SCENARIOS = (Scenario("metrics port", "scrapes and corrections kept out, strangers answered", metrics_port),)
