"""`correct` as a ROS 2 service on rmw_zenoh's keys: the same queue, model and bounds, in ROS's words."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import ExitStack

import zenoh

from gpcorrect_service.ops.logger import Logger
from gpcorrect_service.protocol.errors import EndpointError, ServiceError
from gpcorrect_service.protocol.messages import JSON, ErrorAnswer
from gpcorrect_service.protocol.ros import CALL_ENCODING, CORRECT, RmwNode, reply_attachment, rmw_key, write_refusal
from gpcorrect_service.protocol.sessions import listen_endpoints, open_zenoh, server_config
from gpcorrect_service.protocol.settings import ServerSettings
from gpcorrect_service.server.requests import Clock, Handler, Request, Response, refusal


def open_ros(settings: ServerSettings) -> zenoh.Session:
    """Open a session without a namespace, for ROS's keys have none: a client of the server's own address.

    Parameters
    ----------
    settings : ServerSettings
        Of a server that listens by now, or is a client of a router itself; EndpointError where it cannot be reached.
    """
    config = server_config(settings)
    config.insert_json5("namespace", "null")
    where = listen_endpoints(config)
    if where:
        config.insert_json5("mode", json.dumps("client"))
        config.insert_json5("listen/endpoints", "[]")
        config.insert_json5("connect/endpoints", json.dumps(where))
    hint = "ROS nodes are answered through the server's own address: is it reachable from here?"
    return open_zenoh(config, lambda said: EndpointError(", ".join(where), f"no way to ROS ({said}).", hint=hint))


class RosService:
    """Answers the service `<arm>/correct`, of type gpcorrect_msgs/srv/Correct, by what answers the native key."""

    def __init__(self, settings: ServerSettings, correct: Handler, clock: Clock) -> None:
        assert settings.ros_domain is not None
        self._settings = settings
        self._name = f"{settings.arm}/correct"
        self._correct = correct
        self._clock = clock
        self.key = rmw_key(settings.ros_domain, self._name, CORRECT, settings.ros_distro)

    def declare(
        self, session: zenoh.Session, receive: Callable[[zenoh.Query], None], stack: ExitStack, logger: Logger
    ) -> None:
        """Answer from now on, and show node and service in the ROS graph, until the stack ends.

        Parameters
        ----------
        session : zenoh.Session, without a namespace
        receive : callable, takes a query; must not wait
        stack, logger
        """
        s = self._settings
        assert s.ros_domain is not None
        node = RmwNode(s.ros_domain, str(session.info.zid()), f"gpcorrect_{s.arm}".replace("-", "_"), s.ros_distro)
        callback = zenoh.handlers.Callback(receive, indirect=False)
        stack.enter_context(session.declare_queryable(self.key, callback, complete=True))
        for token in (node.node_token(), node.topic_token(1, "SS", self._name, CORRECT)):
            stack.enter_context(session.liveliness().declare_token(token))
        logger.info("serving ROS", service=f"/{self._name}", type=CORRECT, domain=s.ros_domain, distro=s.ros_distro)

    def answer(self, request: Request) -> Response:
        """Answer a question; what is refused is an answer too, without a command.

        Parameters
        ----------
        request : Request
        """
        asked = Request(request.payload, CALL_ENCODING, b"", request.arrived)
        return self._in_ros(request, self._correct(asked))

    def refuse(self, request: Request, error: ServiceError, replica: str) -> Response:
        """Refuse a question that nobody read, as :func:`refusal` does."""
        return self._in_ros(request, refusal(Request(b"", "", b"", request.arrived), error, replica))

    def _in_ros(self, request: Request, response: Response) -> Response:
        payload = response.payload
        if response.is_error:
            said = JSON.decode(ErrorAnswer, payload)
            payload = write_refusal(said.status, f"{said.cause} {said.next_step}".strip())
        beside = reply_attachment(request.attachment, round(1e9 * self._clock.wall()))
        return Response(payload, "", beside, response.status, rows=response.rows, outside=response.outside)
