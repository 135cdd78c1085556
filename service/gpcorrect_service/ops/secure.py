"""A secured site in one folder: certificates, passwords, and configurations with access rules, ready to use.

Everything meets at a router that speaks TLS only, asks every certificate and password, and lets through what a role
may do, and nothing else: planners ask and move, the operator also changes models, monitors look on, servers answer, the
pre-filter alone sends corrected commands. A role is a certificate and a password, both: a password that leaked is worth
nothing behind another certificate.
"""

from __future__ import annotations

import datetime
import ipaddress
import json
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from gpcorrect.atomic import make_folder
from gpcorrect.errors import DataError
from gpcorrect_service.protocol.ros import CORRECT, dds_name
from gpcorrect_service.protocol.sessions import CLIENT, COMMON, LIVE_KEYS, PREFILTER

ASKED = ("correct", "correct_path", "correct_joints", "model", "health")
ROLES: dict[str, tuple[str, ...]] = {
    "server": (),
    "planner": ASKED,
    "operator": (*ASKED, "metrics", "model/list", "admin/**"),
    "monitor": ("health", "metrics", "model"),
}
ROBOT = "robot"  # it and the pre-filter ask nobody, and are asked by nobody
USERS = (*ROLES, ROBOT, PREFILTER)

# The ROS 2 service of any domain, arm and distribution, and the tokens of the ROS graph; neither has a namespace.
ROS_CORRECT, ROS_GRAPH = f"*/*/correct/{dds_name(CORRECT)}/*", "@ros2_lv/**"

WANTED = ("servo_cp", "move_cp")
CORRECTED = ("corrected/servo_cp", "corrected/move_cp")
JOINTS = ("servo_jp", "move_jp", "state_command")
STATE = (
    "measured_js", "setpoint_js", "external_js", "measured_cp", "setpoint_cp", "tracker_cp", "operating_state",
    "heartbeat", "error", "warning",
)  # fmt: skip
SEEN = (*STATE, "estimate", "corrected/report")
RECEIVED = {
    "server": ("measured_js",),
    "planner": SEEN,
    "operator": (*SEEN, *WANTED, *CORRECTED, "event"),
    "monitor": (*SEEN, "servo_cp", "view"),
    ROBOT: (*WANTED, *CORRECTED, *JOINTS),
    PREFILTER: (*WANTED, "operating_state"),
}
PUBLISHED = {
    "server": ("estimate",),
    "planner": WANTED,
    "operator": (*WANTED, *JOINTS, "event"),
    ROBOT: (*STATE, "view"),  # cameras are a tracker: they speak for the robot
    PREFILTER: (*CORRECTED, "corrected/report", "error"),
}
Right = tuple[str, list[str], list[str], list[str]]
PASSWORD_BYTES = 24  # chosen by hand: 192 bits, beyond guessing
HANDSHAKE_MS = 2000  # chosen by hand: two orders above a handshake in a laboratory; who is slower blocks others
OWNER_ONLY = 0o600  # mode of files


def _access_rules(namespace: str) -> dict[str, Any]:
    """Return the rules of zenoh's access control: what is not named is denied, in both directions."""
    rules: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for user in USERS:
        ids = []
        for name, flows, messages, keys in (*_rights(user, namespace), *_ros_rights(user)):
            if keys:
                ids.append(f"{user} {name}")
                rule = {"id": ids[-1], "permission": "allow", "flows": flows, "messages": messages, "key_exprs": keys}
                rules.append(rule)
        policies.append({"rules": ids, "subjects": [user]})
    # Nobody may delete. The rule gives a subject to those whose certificate and password do not go together, by which
    # zenoh names them where it denies.
    nothing = {"id": "nothing", "permission": "deny", "flows": ["ingress"], "messages": ["delete"], "key_exprs": ["**"]}
    mixed = [
        {"id": f"{user} mixed", "cert_common_names": [user], "usernames": [one for one in USERS if one != user]}
        for user in USERS
    ]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [*rules, nothing],
        # What one subject lists of different kinds must all hold.
        "subjects": [*({"id": user, "cert_common_names": [user], "usernames": [user]} for user in USERS), *mixed],
        "policies": [*policies, {"rules": ["nothing"], "subjects": [subject["id"] for subject in mixed]}],
    }


def _rights(user: str, namespace: str) -> list[Right]:
    """Return name, directions (as the router sees them), messages and keys of what a user may do."""

    def full(keys: Sequence[str]) -> list[str]:
        return [f"{namespace}/*/{key}" for key in keys]

    asked, received, published = (full(part.get(user, ())) for part in (ROLES, RECEIVED, PUBLISHED))
    rights: list[Right] = [
        ("asks", ["ingress"], ["query"], asked),
        ("is answered", ["egress"], ["reply", "declare_queryable"], asked),
        ("subscribes", ["ingress"], ["declare_subscriber"], received),
        ("receives", ["egress"], ["put"], received),
        ("publishes", ["ingress"], ["put"], published),
        ("is subscribed to", ["egress"], ["declare_subscriber"], published),
    ]
    if user == "server":
        everything = full(["**"])
        rights.append(("answers", ["ingress"], ["reply", "declare_queryable", "liveliness_token"], everything))
        rights.append(("is asked", ["egress"], ["query"], everything))
    elif user == PREFILTER:
        own, both = full([f"{PREFILTER}/*"]), ["ingress", "egress"]
        rights.append(("is the only one", both, ["liveliness_token", "liveliness_query"], own))
    elif user in ROLES:
        live = full([LIVE_KEYS])
        rights.append(("asks who lives", ["ingress"], ["liveliness_query", "declare_liveliness_subscriber"], live))
        rights.append(("sees who lives", ["egress"], ["liveliness_token"], live))
    return rights


def _ros_rights(user: str) -> list[Right]:
    """Return the same for ROS 2 nodes: who may ask `correct` may call the service, and see that it is there."""
    if user == "server":
        return [
            ("answers ROS", ["ingress"], ["reply", "declare_queryable"], [ROS_CORRECT]),
            ("is asked by ROS", ["egress"], ["query"], [ROS_CORRECT]),
            ("shows ROS", ["ingress"], ["liveliness_token"], [ROS_GRAPH]),
        ]
    if "correct" not in ROLES.get(user, ()):
        return []
    return [
        ("asks ROS", ["ingress"], ["query"], [ROS_CORRECT]),
        ("is answered by ROS", ["egress"], ["reply", "declare_queryable"], [ROS_CORRECT]),
        ("asks the ROS graph", ["ingress"], ["liveliness_query", "declare_liveliness_subscriber"], [ROS_GRAPH]),
        ("sees the ROS graph", ["egress"], ["liveliness_token"], [ROS_GRAPH]),
    ]


@dataclass(frozen=True)
class Site:
    """What to secure."""

    host: str = "localhost"  # name or number of the router's machine, as clients write it
    port: int = 7450
    namespace: str = "gpcorrect"  # first part of every key
    days: int = 365  # validity of certificates

    @property
    def endpoint(self) -> str:
        """Address of the router."""
        return f"tls/{self.host}:{self.port}"


def secure_site(folder: Path, site: Site, now: datetime.datetime) -> None:
    """Write certificates, passwords and one configuration for the router and for every role.

    Parameters
    ----------
    folder : path
    site : Site
    now : datetime, from which certificates are valid

    Raises
    ------
    DataError, GpCorrectError
        The folder holds a secured site already; it cannot be written.
    """
    if (folder / "ca.pem").exists():
        hint = "Name a new folder; then hand out all its files."
        raise DataError(f"{folder} holds a certificate authority already.", hint=hint)
    make_folder(folder)
    authority = _Authority(f"{site.namespace} authority", now, site.days)
    _write_pair(folder, "ca", authority.certificate, authority.key)
    hosts = tuple(dict.fromkeys((site.host, "localhost", "127.0.0.1")))
    _write_pair(folder, "router", *authority.signed("router", hosts))
    passwords = {user: secrets.token_urlsafe(PASSWORD_BYTES) for user in USERS}
    for user in USERS:
        _write_pair(folder, user, *authority.signed(user))
        _write_private(folder / f"{user}.json5", _client_config(folder, site, user, passwords[user]))
    listed = "".join(f"{user}:{password}\n" for user, password in passwords.items())
    _write_private(folder / "passwords.txt", listed.encode())
    _write_private(folder / "router.json5", _router_config(folder, site))


def _router_config(folder: Path, site: Site) -> bytes:
    own = folder.resolve()
    return _nested(
        {
            **COMMON,
            "mode": "router",
            "listen/endpoints": [f"{site.endpoint}#tls_handshake_timeout_ms={HANDSHAKE_MS}"],
            "transport/unicast/accept_timeout": HANDSHAKE_MS,
            "transport/link/protocols": ["tls"],
            "transport/link/tls": {
                "root_ca_certificate": str(own / "ca.pem"),
                "listen_certificate": str(own / "router.pem"),
                "listen_private_key": str(own / "router.key"),
                "enable_mtls": True,
            },
            "transport/auth/usrpwd": {"dictionary_file": str(own / "passwords.txt")},
            "access_control": _access_rules(site.namespace),
        }
    )


def _client_config(folder: Path, site: Site, user: str, password: str) -> bytes:
    own = folder.resolve()
    return _nested(
        {
            **COMMON,
            **CLIENT,
            "mode": "client",  # a router passes no queries between two peers
            "namespace": site.namespace,
            "connect/endpoints": [site.endpoint],
            "transport/link/tls": {
                "root_ca_certificate": str(own / "ca.pem"),
                "connect_certificate": str(own / f"{user}.pem"),
                "connect_private_key": str(own / f"{user}.key"),
                "enable_mtls": True,
                "verify_name_on_connect": True,
            },
            "transport/auth/usrpwd": {"user": user, "password": password},
        }
    )


def _nested(flat: dict[str, Any]) -> bytes:
    """Return JSON in which zenoh's paths, as `listen/endpoints`, are nested mappings."""
    nested: dict[str, Any] = {}
    for path, value in flat.items():
        *outer, last = path.split("/")
        inner = nested
        for name in outer:
            inner = inner.setdefault(name, {})
        inner[last] = value
    return json.dumps(nested, indent=2).encode()


class _Authority:
    """Signs certificates that are valid from now on; its key is needed again only to sign more of them."""

    def __init__(self, name: str, now: datetime.datetime, days: int) -> None:
        self._name, self._now, self._days = name, now, days
        self.key = ec.generate_private_key(ec.SECP256R1())
        usage = x509.KeyUsage(True, False, False, False, False, True, True, False, False)
        builder = (
            self._builder(name, self.key)
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(usage, critical=True)
        )
        self.certificate = builder.sign(self.key, hashes.SHA256())

    def signed(self, name: str, hosts: tuple[str, ...] = ()) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey]:
        """Return a certificate and its key.

        Parameters
        ----------
        name, hosts : str and tuple of str
            Whose; names and numbers of a server, none for a client.
        """
        key = ec.generate_private_key(ec.SECP256R1())
        uses = [ExtendedKeyUsageOID.CLIENT_AUTH, *([ExtendedKeyUsageOID.SERVER_AUTH] if hosts else [])]
        names: list[x509.GeneralName] = []
        for host in hosts or (name,):
            try:
                names.append(x509.IPAddress(ipaddress.ip_address(host)))
            except ValueError:
                names.append(x509.DNSName(host))
        builder = (
            self._builder(name, key)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
            .add_extension(x509.SubjectAlternativeName(names), critical=False)
        )
        return builder.sign(self.key, hashes.SHA256()), key

    def _builder(self, name: str, key: ec.EllipticCurvePrivateKey) -> x509.CertificateBuilder:
        subject, issuer = (x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, one)]) for one in (name, self._name))
        return (
            x509.CertificateBuilder()
            .subject_name(subject)
            .issuer_name(issuer)
            .public_key(key.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(self._now - datetime.timedelta(minutes=5))  # clocks of the machines differ a little
            .not_valid_after(self._now + datetime.timedelta(days=self._days))
        )


def _write_private(path: Path, data: bytes) -> None:
    """Write a file that only its owner reads."""
    path.touch(mode=OWNER_ONLY)
    path.chmod(OWNER_ONLY)
    path.write_bytes(data)


def _write_pair(folder: Path, name: str, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> None:
    """Write `name.pem` and, for its owner alone, `name.key`."""
    (folder / f"{name}.pem").write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
    encoded = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    _write_private(folder / f"{name}.key", encoded)
