"""Certificates of a zenoh configuration: until when they are valid."""

from __future__ import annotations

import datetime
import json
from pathlib import Path

import zenoh
from cryptography import x509

from gpcorrect.errors import DataError

USED = ("root_ca_certificate", "listen_certificate", "connect_certificate")


class ExpiredError(DataError):
    """A certificate is not valid now."""


def certificate_files(config: zenoh.Config) -> list[Path]:
    """Return the certificate files that a configuration names and that are there.

    Parameters
    ----------
    config : zenoh.Config
    """
    tls = json.loads(config.get_json("transport/link/tls")) or {}
    return [path for path in (Path(tls[name]) for name in USED if tls.get(name)) if path.is_file()]


def check_certificates(config: zenoh.Config, now: datetime.datetime) -> datetime.datetime | None:
    """Return when the first certificate expires; None where the configuration names none.

    What is no certificate is left to zenoh, which says so.

    Parameters
    ----------
    config : zenoh.Config
    now : datetime

    Raises
    ------
    ExpiredError
        One has expired, or is not valid yet.
    """
    ends = []
    for path in certificate_files(config):
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
