"""Which key is answered by whom: one place that joins handlers to keys."""

from __future__ import annotations

from dataclasses import dataclass

from gpcorrect_service.protocol import wire
from gpcorrect_service.server.admin import Admin
from gpcorrect_service.server.health import Health
from gpcorrect_service.server.jobs import Handler
from gpcorrect_service.server.joints import JointHandlers
from gpcorrect_service.server.poses import Handlers

__all__ = ["Route", "routes"]


@dataclass(frozen=True)
class Route:
    """A key, who answers it, and whether it asks the model and so counts against the rate."""

    kind: wire.Kind
    handler: Handler
    throttled: bool = False


def routes(poses: Handlers, joints: JointHandlers, admin: Admin, health: Health) -> tuple[Route, ...]:
    """Return the routes of one server."""
    return (
        Route("correct", poses.correct, throttled=True),
        Route("correct_path", poses.correct_path, throttled=True),
        Route("correct_joints", joints.correct_joints, throttled=True),
        Route("model", poses.model),
        Route("model/list", admin.models),
        Route("health", health.answer),
        Route("metrics", health.metrics),
        Route("admin/activate", admin.activate),
        Route("admin/state", admin.state),
    )
