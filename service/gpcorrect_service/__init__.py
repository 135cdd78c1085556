"""Corrections over zenoh: a server for a fitted model, and clients for planners."""

import gpcorrect_service._libraries  # noqa: F401 - first, so that a missing library is named
from gpcorrect_service.aio import AsyncCorrectionClient
from gpcorrect_service.client import CorrectionClient
from gpcorrect_service.config import ClientSettings, ServerSettings
from gpcorrect_service.errors import EndpointError, ServiceError
from gpcorrect_service.replies import CorrectionReply, JointsReply, PathReply

__all__ = [
    "AsyncCorrectionClient",
    "ClientSettings",
    "CorrectionClient",
    "CorrectionReply",
    "EndpointError",
    "JointsReply",
    "PathReply",
    "ServerSettings",
    "ServiceError",
]
