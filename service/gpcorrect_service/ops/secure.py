"""A secured site in one folder: certificates, passwords, and configurations with access rules, ready to use.

Everything meets at a router that speaks TLS only, asks every certificate and password, and lets through what a role
may do, and nothing else: planners ask and move, the operator also changes models, monitors look on, servers answer, the
pre-filter alone sends corrected commands.
"""

from __future__ import annotations

import datetime
import ipaddress
import json
import secrets
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from gpcorrect.atomic import make_folder
from gpcorrect.errors import DataError
from gpcorrect_service.ops.access import USERS, access_rules
from gpcorrect_service.protocol.sessions import CLIENT, COMMON

PASSWORD_BYTES = 24  # chosen by hand: 192 bits, beyond guessing
HANDSHAKE_MS = 2000  # chosen by hand: two orders above a handshake in a laboratory; who is slower blocks others
OWNER_ONLY = 0o600  # mode of files


@dataclass(frozen=True)
class Site:
    """What to secure.

    Parameters
    ----------
    host : str
        Name or number of the router's machine, as clients write it.
    port : int
    namespace : str
        First part of every key.
    days : int
        Validity of certificates.
    """

    host: str = "localhost"
    port: int = 7450
    namespace: str = "gpcorrect"
    days: int = 365

    @property
    def endpoint(self) -> str:
        """Address of the router."""
        return f"tls/{self.host}:{self.port}"


def secure_site(folder: Path, site: Site, now: datetime.datetime) -> None:
    """Write certificates, passwords and one configuration for the router and for every role.

    Parameters
    ----------
    folder : path
        Made.
    site : Site
    now : datetime
        From which certificates are valid.

    Raises
    ------
    DataError
        The folder holds a secured site already.
    GpCorrectError
        It cannot be written.
    """
    if (folder / "ca.pem").exists():
        raise DataError(
            f"{folder} holds a certificate authority already.", hint="Name a new folder; then hand out all its files."
        )
    make_folder(folder)
    authority = _Authority.new(f"{site.namespace} authority", now, site.days)
    _write_pair(folder, "ca", authority.certificate, authority.key)
    hosts = tuple(dict.fromkeys((site.host, "localhost", "127.0.0.1")))
    _write_pair(folder, "router", *authority.sign("router", hosts, now, site.days))
    passwords = {user: secrets.token_urlsafe(PASSWORD_BYTES) for user in USERS}
    for user in USERS:
        _write_pair(folder, user, *authority.sign(user, (), now, site.days))
        _write_private(folder / f"{user}.json5", _json(_client_config(folder, site, user, passwords[user])))
    listed = "".join(f"{user}:{password}\n" for user, password in passwords.items())
    _write_private(folder / "passwords.txt", listed.encode())
    _write_private(folder / "router.json5", _json(_router_config(folder, site)))


def _router_config(folder: Path, site: Site) -> dict[str, Any]:
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
            "access_control": access_rules(site.namespace),
        }
    )


def _client_config(folder: Path, site: Site, user: str, password: str) -> dict[str, Any]:
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


def _nested(flat: dict[str, Any]) -> dict[str, Any]:
    """Turn zenoh's paths, as `listen/endpoints`, into nested mappings."""
    nested: dict[str, Any] = {}
    for path, value in flat.items():
        *outer, last = path.split("/")
        inner = nested
        for name in outer:
            inner = inner.setdefault(name, {})
        inner[last] = value
    return nested


def _json(value: dict[str, Any]) -> bytes:
    return json.dumps(value, indent=2).encode()


@dataclass(frozen=True)
class _Authority:
    """Signs certificates; its key is needed again only to sign more of them."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey

    @classmethod
    def new(cls, name: str, now: datetime.datetime, days: int) -> _Authority:
        """Make one that is valid from now on.

        Parameters
        ----------
        name : str
        now : datetime
        days : int
        """
        key = ec.generate_private_key(ec.SECP256R1())
        builder = _builder(name, name, key, now, days).add_extension(
            x509.BasicConstraints(ca=True, path_length=0), critical=True
        )
        usage = x509.KeyUsage(True, False, False, False, False, True, True, False, False)
        builder = builder.add_extension(usage, critical=True)
        return cls(builder.sign(key, hashes.SHA256()), key)

    def sign(
        self, name: str, hosts: tuple[str, ...], now: datetime.datetime, days: int
    ) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey]:
        """Return a certificate and its key.

        Parameters
        ----------
        name : str
        hosts : tuple of str
            Of a server; empty for a client.
        now : datetime
        days : int
        """
        key = ec.generate_private_key(ec.SECP256R1())
        issuer = str(self.certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value)
        uses = [ExtendedKeyUsageOID.CLIENT_AUTH, *([ExtendedKeyUsageOID.SERVER_AUTH] if hosts else [])]
        names: list[x509.GeneralName] = []
        for host in hosts or (name,):
            try:
                names.append(x509.IPAddress(ipaddress.ip_address(host)))
            except ValueError:
                names.append(x509.DNSName(host))
        builder = (
            _builder(name, issuer, key, now, days)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
            .add_extension(x509.SubjectAlternativeName(names), critical=False)
        )
        return builder.sign(self.key, hashes.SHA256()), key


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


def _builder(
    name: str, issuer: str, key: ec.EllipticCurvePrivateKey, now: datetime.datetime, days: int
) -> x509.CertificateBuilder:
    def _common(text: str) -> x509.Name:
        return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])

    return (
        x509.CertificateBuilder()
        .subject_name(_common(name))
        .issuer_name(_common(issuer))
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(minutes=5))  # clocks of the machines differ a little
        .not_valid_after(now + datetime.timedelta(days=days))
    )
