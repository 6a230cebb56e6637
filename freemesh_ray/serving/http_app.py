"""The HTTP app: paths, limits, errors in one line of JSON. It knows neither Ray nor how meshes are made."""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import json
import time
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import asdict
from http import HTTPStatus

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from freemesh_ray.serving.answer import NAME, Answer, MeshRequest, Refused, refusal
from freemesh_ray.serving.counters import CLIENT_LEFT, MESH, Counters
from freemesh_ray.serving.formats import JSON, MEDIA_TYPES
from freemesh_ray.serving.limits import Limits
from freemesh_ray.serving.parameters import ParameterError, parameters, value_types

#: Paths that are counted by name.
PATHS = ("/", MESH, "/health", "/metrics")

#: Seconds after which a client that was turned away may try again.
RETRY_AFTER = 1

#: Digits of a Content-Length that is worth reading.
DIGITS = 15


class Busy(Exception):
    """There is no room for one more request."""


def digest(token: str) -> bytes:
    """The SHA-256 of a token, which is all that is kept of it."""
    return hashlib.sha256(token.encode()).digest()


def asgi_app(
    mesh: Callable[[MeshRequest], Awaitable[Answer]],
    running: Callable[[], Awaitable[int]],
    *,
    densities: Sequence[str],
    limits: Limits,
    token: bytes | None,
    counters: Counters,
) -> ASGIApp:
    """The ASGI application.

    Args:
        mesh: answers a request; raises `Busy`.
        running: how many meshers can take one.
        densities: that ``mesh`` has policies for.
        limits: of a request.
        token: digest of the bearer token that all paths but ``/health`` ask for; None: none is asked for.
        counters: where requests are counted.
    """
    endpoints = _Endpoints(mesh, running, densities, limits, counters)
    routes = [
        Route("/", endpoints.usage),
        Route(MESH, endpoints.mesh, methods=["POST"]),
        Route("/health", endpoints.health),
        Route("/metrics", endpoints.metrics),
    ]
    application = Starlette(
        routes=routes, exception_handlers={HTTPException: _http_error, Refused: _refused, Exception: _mistake}
    )
    application.router.redirect_slashes = False
    return _Counted(application if token is None else _Guarded(application, token), counters)


class _Endpoints:
    """What the paths answer."""

    def __init__(
        self,
        mesh: Callable[[MeshRequest], Awaitable[Answer]],
        running: Callable[[], Awaitable[int]],
        densities: Sequence[str],
        limits: Limits,
        counters: Counters,
    ) -> None:
        self._mesh, self._running, self._densities = mesh, running, densities
        self._limits, self._counters, self._at_once = limits, counters, 0

    async def mesh(self, request: Request) -> Response:
        """``POST /mesh``."""
        began = time.perf_counter()
        if self._at_once >= self._limits.at_once:
            raise _busy()
        self._at_once += 1
        self._counters.began()
        try:
            return await self._meshed(request)
        finally:
            self._at_once -= 1
            self._counters.ended(time.perf_counter() - began)

    async def _meshed(self, request: Request) -> Response:
        try:
            wanted = parameters(request.query_params.multi_items(), self._densities, self._limits)
        except ParameterError as error:
            raise Refused(HTTPStatus.BAD_REQUEST, str(error)) from None
        body = await self._body(request)
        try:
            answer = await self._mesh(MeshRequest(body, wanted))
        except Busy:
            raise _busy() from None
        headers = {}
        if answer.elements:
            self._counters.meshed(answer.elements)
            if wanted.format != JSON:
                headers["Content-Disposition"] = f'attachment; filename="{NAME}.{wanted.format}"'
        return Response(answer.body, answer.status, headers, answer.media_type)

    async def _body(self, request: Request) -> bytes:
        """The request's body.

        Raises:
            Refused: it is too large, which may be clear before it is read, or does not come.
        """
        most = self._limits.body_bytes
        too_large = Refused(
            HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
            f"body: more than {most / 1e6:g} MB; simplify the polygon or leave digits out",
        )
        declared = request.headers.get("content-length", "")
        if declared.isdecimal() and (len(declared) > DIGITS or int(declared) > most):
            raise too_large
        body = bytearray()
        try:
            async with asyncio.timeout(self._limits.upload_seconds):
                async for chunk in request.stream():
                    body += chunk
                    if len(body) > most:
                        raise too_large
        except TimeoutError:
            line = f"body: not here after {self._limits.upload_seconds:g} s; send it at once"
            raise Refused(HTTPStatus.REQUEST_TIMEOUT, line) from None
        except ClientDisconnect:
            raise Refused(CLIENT_LEFT, "body: cut off") from None
        return bytes(body)

    async def health(self, request: Request) -> Response:
        """``GET /health``: 200 when a mesh can be made."""
        running = await self._running()
        status = HTTPStatus.OK if running else HTTPStatus.SERVICE_UNAVAILABLE
        return _json({"status": "ok" if running else "no mesher is running", "meshers": running}, status)

    async def metrics(self, request: Request) -> Response:
        """``GET /metrics``."""
        page, media_type = self._counters.page()
        return Response(page, headers={"Content-Type": media_type})

    async def usage(self, request: Request) -> Response:
        """``GET /``: how to use it."""
        return _json(
            {
                "service": "freemesh: a polygon in, an all-quad mesh out",
                "use": "POST a GeoJSON Polygon to /mesh?edge_length=0.1&format=json",
                "parameters": {name: one.wanted for name, one in value_types(self._densities, self._limits).items()},
                "limits": asdict(self._limits),
                "paths": list(PATHS),
            },
            HTTPStatus.OK,
        )


class _Guarded:
    """Asks for the token on all paths but ``/health``, which balancers probe."""

    def __init__(self, application: ASGIApp, token: bytes) -> None:
        self._application, self._token = application, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and scope["path"] != "/health":
            scheme, _, given = Request(scope).headers.get("authorization", "").partition(" ")
            # Digests have one length, and are compared in one time.
            if not hmac.compare_digest(digest(given.strip()), self._token) or scheme.lower() != "bearer":
                line = "token: missing or wrong; send the header Authorization: Bearer TOKEN"
                await _error(HTTPStatus.UNAUTHORIZED, line, {"WWW-Authenticate": "Bearer"})(scope, receive, send)
                return
        await self._application(scope, receive, send)


class _Counted:
    """Counts what is answered."""

    def __init__(self, application: ASGIApp, counters: Counters) -> None:
        self._application, self._counters = application, counters

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._application(scope, receive, send)
            return
        status = CLIENT_LEFT

        async def told(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        try:
            await self._application(scope, receive, told)
        finally:
            self._counters.answered(scope["path"] if scope["path"] in PATHS else "other", status)


def _busy() -> HTTPException:
    line = "busy: all meshers are at work and the queue is full; try again"
    return HTTPException(HTTPStatus.SERVICE_UNAVAILABLE, line, {"Retry-After": str(RETRY_AFTER)})


async def _refused(request: Request, refused: Exception) -> Response:
    """What is wrong with a request; where its body was not read to the end, the connection is of no more use."""
    assert isinstance(refused, Refused)
    unread = refused.status in (HTTPStatus.REQUEST_ENTITY_TOO_LARGE, HTTPStatus.REQUEST_TIMEOUT)
    return _error(refused.status, str(refused), {"Connection": "close"} if unread else {})


async def _http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    headers = dict(error.headers or {})
    line = error.detail
    if error.status_code == HTTPStatus.NOT_FOUND:
        line = f"path: not known; there are {', '.join(PATHS)}"
    elif error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        allowed = ", ".join(sorted(headers.get("Allow", "").split(", ")))
        line = f"method {request.method}: not for this path; use {allowed}"
    return _error(error.status_code, line, headers)


async def _mistake(request: Request, error: Exception) -> Response:
    """A mistake of ours: the log has it."""
    return _error(HTTPStatus.INTERNAL_SERVER_ERROR, "the server made a mistake; its log says which", {})


def _error(status: int, line: str, headers: dict[str, str]) -> Response:
    answer = refusal(status, line)
    return Response(answer.body, status, headers, answer.media_type)


def _json(value: object, status: int) -> Response:
    return Response(json.dumps(value).encode() + b"\n", status, media_type=MEDIA_TYPES[JSON])
