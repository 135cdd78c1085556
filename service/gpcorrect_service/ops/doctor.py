"""Why does nobody answer? zenoh shows a client zero replies whatever the cause; here each is looked for by itself.

Validity of certificates, address, port, TLS, password, keys: in this order, for each needs the one before; the first
that fails is the answer.
"""

from __future__ import annotations

import json
import socket
import ssl
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import zenoh

from gpcorrect.errors import DataError
from gpcorrect_service.ops.secure import ROLES, USERS
from gpcorrect_service.protocol import sessions
from gpcorrect_service.protocol.errors import EndpointError
from gpcorrect_service.protocol.settings import ENDPOINT, ClientSettings

PATIENCE = 3.0  # chosen by hand: s for each step
REFUSAL_SECONDS = 0.5  # chosen by hand: in which a refusal of the client's certificate arrives
SETTLED_SECONDS = 0.5  # chosen by hand: without change after which no further key is expected
KEYS = (
    *("health", "model", "correct", "correct_path", "correct_joints"),
    *("metrics", "model/list", "admin/activate", "admin/state"),
)
# Keys that who asks for corrections needs; of a secured site's roles those that they are for. Others may be denied.
NEEDED = ("health", "correct")
EXPIRED, FOREIGN, MISSING = "expired certificate", "foreign certificate", "missing certificate"
TLS_TROUBLE = (
    (
        "HAS_EXPIRED",
        EXPIRED,
        "{router}, or its authority's, has expired: secure the site anew (gpcorrect secure init).",
    ),
    ("NOT_YET_VALID", EXPIRED, "{router} is not valid yet: compare the clocks of both machines."),
    (
        "CERTIFICATE_EXPIRED",
        EXPIRED,
        "The router takes {own} for expired: compare the clocks, or secure the site anew.",
    ),
    (
        "CERTIFICATE_VERIFY_FAILED",
        FOREIGN,
        "{router} is not from the authority in root_ca_certificate, or not for this host name.",
    ),
    (
        "CERTIFICATE_REQUIRED",
        MISSING,
        "The router asks for a client certificate: set connect_certificate and connect_private_key.",
    ),
    ("UNKNOWN_CA", FOREIGN, "The router does not know the authority of {own}: have one signed by its own."),
    ("CERTIFICATE_UNKNOWN", FOREIGN, "The router does not take {own}: have one signed by its authority."),
    ("DECRYPT_ERROR", FOREIGN, "The router does not take {own}: have one signed by its authority."),
    ("WRONG_VERSION_NUMBER", "no TLS there", "The other side speaks plain TCP: write tcp/, or secure the router."),
)
"""What OpenSSL's error holds, what is the matter, and what to do, in which {router} and {own} are the certificates."""


@dataclass(frozen=True)
class Finding:
    """One step: what was looked at, whether it is well, what was found, and what to do."""

    step: Literal["address", "port", "tls", "login", "server", "models", "key"]
    what: str
    well: bool
    cause: str = ""
    next_step: str = ""


def examine(settings: ClientSettings) -> Iterator[Finding]:
    """Yield findings, to the first trouble that hides the rest; DataError for a configuration that cannot be read.

    Parameters
    ----------
    settings : ClientSettings
    """
    config = sessions.client_config(settings)
    try:
        end = sessions.check_certificates(config)
    except sessions.ExpiredError as error:
        yield Finding("tls", str(settings.config_file), False, EXPIRED, f"{error.message} {error.hint}")
        return
    if end is not None:
        yield Finding("tls", str(settings.config_file), True, f"certificates are valid until {end:%Y-%m-%d}")
    endpoints = json.loads(config.get_json("connect/endpoints"))
    if isinstance(endpoints, dict):  # one list a mode
        endpoints = [one for some in endpoints.values() for one in some]
    if not isinstance(endpoints, list):
        raise DataError(f"connect/endpoints must be a list, got {endpoints!r}.")
    if not endpoints:
        yield Finding("address", "endpoints", False, "the configuration names no address", "Set connect/endpoints.")
    links = []
    for endpoint in map(str, endpoints):
        links.append(list(_link(endpoint, config)))
        yield from links[-1]
    if any(all(finding.well for finding in link) for link in links):
        yield from _conversation(config, settings, endpoints)


def _link(endpoint: str, config: zenoh.Config) -> Iterator[Finding]:
    """Look at address, port and TLS of one endpoint."""
    match = ENDPOINT.fullmatch(endpoint)
    if match is None:
        yield Finding("address", endpoint, False, "this is not an address", "Write protocol/host:port.")
        return
    host, port = match["host"].strip("[]"), int(match["port"])
    trouble: tuple[str, ...] = ()
    try:
        socket.create_connection((host, port), PATIENCE).close()
    except socket.gaierror:
        trouble = "unknown host", f"Nobody knows the name {host}: check its spelling, or write the number."
    except ConnectionRefusedError:
        listen = f"The machine answers, but nothing listens on port {port}: start the server or router."
        trouble = "closed port", listen
    except OSError as error:
        trouble = "unreachable", f"No way to {host} ({error.strerror or error}): a firewall, or the machine is off."
    yield Finding("port", endpoint, not trouble, *trouble)
    if not trouble and match["protocol"] in ("tls", "quic"):
        trouble = _handshake(host, port, json.loads(config.get_json("transport/link/tls")))
        yield Finding("tls", endpoint, not trouble, *trouble)


def _handshake(host: str, port: int, tls: dict[str, Any]) -> tuple[str, ...]:
    """Do the TLS handshake as zenoh would; a refusal of the client's certificate comes with the first byte read."""
    try:
        context = ssl.create_default_context(cafile=tls.get("root_ca_certificate"))
        if tls.get("connect_certificate"):
            context.load_cert_chain(tls["connect_certificate"], tls.get("connect_private_key"))
        dialled = socket.create_connection((host, port), PATIENCE)
        with dialled as raw, context.wrap_socket(raw, server_hostname=host) as link:
            link.settimeout(REFUSAL_SECONDS)
            link.recv(1)
    except TimeoutError:
        return ()  # zenoh waits for the client to speak first: the handshake is done
    except (FileNotFoundError, PermissionError) as error:
        return MISSING, f"{error.filename or 'A certificate file'} cannot be read: {error.strerror}."
    except ssl.SSLError as error:
        text = f"{error.reason} {error}".upper().replace(" ", "_")
        for sign, cause, next_step in TLS_TROUBLE:
            if sign in text:
                return cause, next_step.format(router="The router's certificate", own="this client's certificate")
        return "TLS refused", f"The handshake failed: {error}."
    except OSError as error:
        return "TLS refused", f"The other side ended the handshake ({error})."
    return ()


def _conversation(config: zenoh.Config, settings: ClientSettings, endpoints: list[str]) -> Iterator[Finding]:
    """Look at login, server and keys, behind a link that stands."""
    for key, value in (("connect/exit_on_failure", True), ("connect/timeout_ms", int(1e3 * PATIENCE))):
        config.insert_json5(key, json.dumps(value))
    where = f"{settings.namespace}/{settings.arm}"
    try:
        session = sessions.open_zenoh(config, lambda said: EndpointError(where, said))
    except EndpointError:
        yield Finding("login", where, False, *_login_trouble(config, endpoints))
        return
    user = json.loads(config.get_json("transport/auth/usrpwd/user"))
    needed = tuple(key for key in NEEDED if key in ROLES.get(user, ())) if user in USERS else NEEDED
    with session:
        yield Finding("login", where, True)
        if not needed:
            yield Finding("server", where, True, f"not looked for: {user} asks no server")
            return
        seen = _visible_keys(session, settings.arm)
        # Tokens of the servers of all arms; none where the access rules hide them.
        replies = session.liveliness().get(f"*/{sessions.LIVE_KEYS}", timeout=PATIENCE)
        tokens = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
        differ = sessions.differing(token for token in tokens if token.startswith(f"{settings.arm}/"))
    if not any(seen.values()):
        step = "No key of this arm is to be seen: does a server run under these names, and may this user ask it?"
        if others := {token.split("/")[0] for token in tokens} - {settings.arm}:
            step += f" There are servers of other arms here: --arm {' or '.join(sorted(others))}"
        yield Finding("server", where, False, "no server, or every key denied", step)
        return
    yield Finding("server", where, True)
    for task, holders in differ.items():
        cause = f"the servers hold different models of {task}: {', '.join(holders)}"
        step = "Give all of them the same one: gpcorrect models activate NAME --endpoint ..."
        yield Finding("models", where, False, cause, step)
    if not differ:
        yield Finding("models", where, True)
    for key, visible in seen.items():
        if visible:
            yield Finding("key", f"{where}/{key}", True)
        else:
            next_step = "Others of this server are seen, this one is not: the access rules of this user leave it out."
            yield Finding("key", f"{where}/{key}", key not in needed, "denied key", next_step)


def _login_trouble(config: zenoh.Config, endpoints: list[str]) -> tuple[str, str]:
    for match in filter(None, map(ENDPOINT.fullmatch, endpoints)):
        if match["protocol"] == "tcp" and _speaks_tls(match["host"].strip("[]"), int(match["port"])):
            next_step = "The other side speaks TLS: write tls/ in the endpoint, with certificates."
            return "plain TCP to a TLS port", next_step
    user = json.loads(config.get_json("transport/auth/usrpwd/user"))
    if user:
        next_step = f"The link stands, but user {user!r} is not let in: compare with passwords.txt."
        return "wrong user or password", next_step
    return "not let in", "The link stands, but zenoh's greeting fails: a user and password may be asked for."


def _speaks_tls(host: str, port: int) -> bool:
    """Whether a TLS greeting is answered in TLS, by a refusal too."""
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    try:
        with socket.create_connection((host, port), 1.0) as raw, context.wrap_socket(raw):
            return True
    except ssl.SSLError as error:
        return error.reason not in (None, "WRONG_VERSION_NUMBER", "UNEXPECTED_EOF_WHILE_READING")
    except OSError:
        return False


def _visible_keys(session: zenoh.Session, arm: str) -> dict[str, bool]:
    """Return which keys a server declares, looking until all are seen or what is seen has not changed for a while."""
    queriers = {key: session.declare_querier(f"{arm}/{key}") for key in KEYS}
    began = changed = time.monotonic()
    seen: dict[str, bool] = {}
    while time.monotonic() < began + PATIENCE:
        statuses: dict[str, Any] = {key: querier.matching_status for key, querier in queriers.items()}
        now = {key: bool(status.matching) for key, status in statuses.items()}
        if now != seen:
            seen, changed = now, time.monotonic()
        if all(seen.values()) or (any(seen.values()) and time.monotonic() > changed + SETTLED_SECONDS):
            break
        time.sleep(0.02)
    return seen
