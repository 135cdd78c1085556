"""The page over HTTP: static files, one snapshot, and a stream of snapshots; nothing can be sent to it.

Server-sent events go one way, so that reading is all that the page can do.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from importlib import resources

from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gpcorrect_service.monitor.board import Board

EVERY = 0.2  # chosen by hand: s between snapshots
FILES = {
    "/": ("page.html", "text/html"),
    "/page.css": ("page.css", "text/css"),
    "/page.js": ("page.js", "text/javascript"),
}
HEADERS = {
    b"content-security-policy": b"default-src 'self'; frame-ancestors 'none'",
    b"x-content-type-options": b"nosniff",
    b"cache-control": b"no-store",
    b"referrer-policy": b"no-referrer",
}


def application(board: Board, hosts: list[str], closing: Callable[[], bool] = lambda: False) -> Starlette:
    """Return the page's server.

    Parameters
    ----------
    board : Board
    hosts : list of str
        Names under which it may be asked; others are turned away, so that no other page can borrow this one's.
    closing : callable, whether the server is about to stop: streams end then
    """

    async def _state(request: Request) -> Response:
        return JSONResponse(board.snapshot(time.monotonic()))

    async def _events(request: Request) -> Response:
        return StreamingResponse(_stream(board, request, closing), media_type="text/event-stream")

    async def _view(request: Request) -> Response:
        picture = board.picture(request.path_params["arm"])
        return Response(status_code=404) if picture is None else Response(picture, media_type="image/jpeg")

    async def _no_icon(request: Request) -> Response:
        return Response(status_code=204)

    served = {path: _file(*what) for path, what in FILES.items()}
    served |= {"/api/state": _state, "/events": _events, "/view/{arm}": _view, "/favicon.ico": _no_icon}
    return Starlette(
        routes=[Route(path, answer, methods=["GET"]) for path, answer in served.items()],
        middleware=[Middleware(TrustedHostMiddleware, allowed_hosts=hosts), Middleware(_Headers)],
    )


async def _stream(board: Board, request: Request, closing: Callable[[], bool]) -> AsyncIterator[str]:
    while not (closing() or await request.is_disconnected()):
        yield f"data: {json.dumps(board.snapshot(time.monotonic()), allow_nan=False)}\n\n"
        await asyncio.sleep(EVERY)


def _file(name: str, media_type: str) -> Callable[[Request], Awaitable[Response]]:
    text = resources.files("gpcorrect_service.monitor").joinpath("page", name).read_text(encoding="utf-8")

    async def _serve(request: Request) -> Response:
        return Response(text, media_type=media_type)

    return _serve


class _Headers:
    """Adds what keeps a browser from doing more with the page than showing it."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def _with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *HEADERS.items()]
            await send(message)

        await self._app(scope, receive, _with_headers)
