"""A zenoh router in a process of its own: what `zenohd` is, for machines that have Python alone.

Who was denied what is read from zenoh's own log, the only place where it says so.
"""

from __future__ import annotations

import fcntl
import os
import re
import select
import socket
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import zenoh

from gpcorrect.errors import DataError
from gpcorrect_service.ops.logger import Logger, open_logger
from gpcorrect_service.protocol.errors import EndpointError
from gpcorrect_service.protocol.sessions import open_zenoh, read_config, wait_for

# What zenoh 1.10 says, and on which level: denials among what it allows, logins and handshakes that fail.
DIRECTIVES = (
    "zenoh::net::routing::interceptor::access_control=trace",
    "zenoh_transport::unicast::establishment::accept=debug",
    "zenoh_link_tls::unicast=debug",
)
COLOUR = re.compile(r"\x1b\[[0-9;]*m")
# As the router sees it, ingress is what somebody tried; egress is what others sent and is not for him: no denial.
DECIDED = re.compile(
    r" (?P<session>[0-9a-f]+) on (?P<subject>\S+) is (?P<un>un)?authorized"
    r" to (?P<what>[^(]+) \(ingress\) on (?P<key>\S+)"
)
NAMED = re.compile(r"(?P<kind>CertCommonName|Username)\((?P<name>[^)]*)\)")
LINKED = re.compile(r"Accepted TLS connection on \S+: (?P<address>\S+)\. Common Name: (?P<name>.*)\.$")
LOGIN = re.compile(r"UsrPwd extension - .*?\. (?P<cause>[^.]+)\.")
HANDSHAKE = re.compile(r" WARN .*zenoh_link_tls::unicast: (?P<cause>.+?)(?:\. Hint.*)?$")
GROUP_SECONDS = 0.1  # chosen by hand: in which the decisions about a key that a session declares are all there
MOST = 20  # chosen by hand: lines a second, so that who asks a thousand times a second fills no disk
PIPE_BYTES = 1 << 20  # the largest that Linux gives to everybody: some thousand lines
STDOUT = 1  # file descriptor, by POSIX
SILENT_SECONDS = 60  # chosen by hand: as long as the kernel asks again (tcp_synack_retries); then it goes to zenoh


@dataclass
class _Decisions:
    """What a session may and may not do with a key, as zenoh decided it just now."""

    since: float
    certificate: str
    user: str
    denied: list[str] = field(default_factory=list)
    allowed: bool = False


@dataclass
class DenialReader:
    """Writes the lines of zenoh's log that say of a denial, a refused login or handshake, a bounded number a second.

    Of a key that a session declares zenoh decides everything at once, whatever it is declared for; what it may use in
    some way is then no denial.
    """

    logger: Logger
    monotonic: Callable[[], float] = time.monotonic  # clock, s
    _open: dict[tuple[str, str], _Decisions] = field(default_factory=dict)
    _linked_last: str = ""
    _began: float = float("-inf")
    _written: int = 0

    def read(self, line: str) -> None:
        """Take one line of zenoh's log.

        Parameters
        ----------
        line : str
        """
        line = COLOUR.sub("", line.rstrip())
        if found := DECIDED.search(line):
            who = {one["kind"]: one["name"] for one in NAMED.finditer(found["subject"])}
            fresh = _Decisions(self.monotonic(), who.get("CertCommonName", ""), who.get("Username", ""))
            decisions = self._open.setdefault((found["session"], found["key"]), fresh)
            if found["un"]:
                decisions.denied.append(found["what"])
            else:
                decisions.allowed = True
        elif found := LINKED.search(line):
            self._linked_last = f"{found['name']} at {found['address']}"
        elif found := LOGIN.search(line):
            # zenoh does not name the link; the one accepted last is nearly always the one that is refused.
            self._write("login refused", cause=found["cause"], linked_last=self._linked_last)
        elif found := HANDSHAKE.search(line):
            self._write("handshake refused", cause=found["cause"])

    def flush(self) -> None:
        """Write of the denials whose group is complete; to be called from time to time."""
        now = self.monotonic()
        for (session, key), one in list(self._open.items()):
            if now < one.since + GROUP_SECONDS:
                continue
            del self._open[session, key]
            if one.denied and not one.allowed:
                what = "any use" if len(set(one.denied)) > 1 else one.denied[0]
                self._write("denied", certificate=one.certificate, user=one.user, session=session, what=what, key=key)

    def _write(self, event: str, **facts: str) -> None:
        now = self.monotonic()
        if now > self._began + 1.0:
            if self._written > MOST:
                self.logger.warning("more was denied than is written", unwritten=self._written - MOST)
            self._began, self._written = now, 0
        self._written += 1
        if self._written <= MOST:
            self.logger.warning(event, **facts)


@contextmanager
def _denials_logged(logger: Logger) -> Iterator[None]:
    """Log who is denied what by zenoh sessions that are opened inside the block; for a process of its own.

    zenoh writes its log to standard output, which is read here meanwhile. It never waits for the reader: lines that
    find no room are lost. Where the caller had set RUST_LOG, its lines go on to standard output as before.
    """
    wanted = os.environ.get("RUST_LOG", "")
    os.environ["RUST_LOG"] = ",".join(filter(None, (wanted, *DIRECTIVES)))
    sys.stdout.flush()
    reading, writing, before = *os.pipe(), os.dup(STDOUT)
    os.set_blocking(writing, False)
    with suppress(OSError):  # another size serves as well
        fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
    os.dup2(writing, STDOUT)
    os.close(writing)
    thread = threading.Thread(
        target=_pump, args=(reading, before if wanted else None, DenialReader(logger)), daemon=True
    )
    thread.start()
    try:
        zenoh.try_init_log_from_env()  # type: ignore[no-untyped-call]  # zenoh's stub says nothing
        yield
    finally:
        os.dup2(before, STDOUT)
        thread.join()
        os.close(before)


def _pump(reading: int, onward: int | None, reader: DenialReader) -> None:
    """Read lines until nobody can write any more."""
    rest = b""
    while True:
        if select.select([reading], [], [], GROUP_SECONDS)[0]:
            data = os.read(reading, PIPE_BYTES)
            if not data:
                break
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                if b"authorized to" in line and b"(egress)" in line:
                    continue
                reader.read(line.decode(errors="replace"))
                if onward is not None:
                    os.write(onward, line + b"\n")
        reader.flush()
    os.close(reading)


def route(
    config_file: Path, stop: threading.Event, on_ready: Callable[[], None] | None = None, logger: Logger | None = None
) -> None:
    """Route until stopped, and log who is denied what; for a process of its own, whose standard output is taken.

    Parameters
    ----------
    config_file : path, zenoh's, JSON5, with mode "router"
    stop : threading.Event
    on_ready : callable, optional
    logger : Logger, optional, standard error by default

    Raises
    ------
    DataError, EndpointError
        The configuration cannot be read, or is not a router's; the address is taken or cannot be used.
    """
    config = read_config(config_file)
    if config.get_json("mode") != '"router"':
        raise DataError(f"{config_file} is not a router's configuration.", hint='Its mode must be "router".')
    with _denials_logged(logger or open_logger()):
        where, hint = str(config_file), "Another one may hold this address."
        with open_zenoh(config, lambda said: EndpointError(where, f"the router cannot listen ({said}).", hint=hint)):
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
