"""Says which library is missing before another module stumbles over it; imported first."""

from __future__ import annotations

from importlib.util import find_spec

from gpcorrect.errors import MissingExtraError

LIBRARIES = {
    "zenoh": "eclipse-zenoh",
    "msgspec": "msgspec",
    "structlog": "structlog",
    "prometheus_client": "prometheus-client",
}

for _module, _library in LIBRARIES.items():
    if find_spec(_module) is None:
        raise MissingExtraError(_library, extra="service", purpose="the correction service")
