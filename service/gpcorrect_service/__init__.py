"""Corrections over zenoh: a server for a fitted model, and clients for planners."""

from importlib.util import find_spec

from gpcorrect.errors import MissingExtraError

for _module, _library in (
    ("zenoh", "eclipse-zenoh"),
    ("msgspec", "msgspec"),
    ("structlog", "structlog"),
    ("prometheus_client", "prometheus-client"),
):
    if find_spec(_module) is None:
        raise MissingExtraError(_library, extra="service", purpose="the correction service")

# Only now, so that a missing library is named before a module stumbles over it.
from gpcorrect_service.client.clients import AsyncCorrectionClient, CorrectionClient  # noqa: E402
from gpcorrect_service.client.replies import Reply  # noqa: E402
from gpcorrect_service.protocol.errors import EndpointError, ServiceError  # noqa: E402
from gpcorrect_service.protocol.settings import ClientSettings, ServerSettings  # noqa: E402

__all__ = [
    "AsyncCorrectionClient",
    "ClientSettings",
    "CorrectionClient",
    "EndpointError",
    "Reply",
    "ServerSettings",
    "ServiceError",
]
