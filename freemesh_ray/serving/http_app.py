"""The HTTP app: paths, limits, errors in one line of JSON. It knows neither Ray nor how meshes are made."""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import json
import time
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import asdict
from http import HTTPStatus
from typing import Any

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from freemesh_ray.serving.answer import NAME, Answer, MeshRequest, Refused
from freemesh_ray.serving.awake import awake_timeout
from freemesh_ray.serving.connections import client_address
from freemesh_ray.serving.counters import CLIENT_LEFT, MESH, Counters
from freemesh_ray.serving.errors import error_response
from freemesh_ray.serving.formats import JSON, MEDIA_TYPES
from freemesh_ray.serving.hosts import KnownHosts
from freemesh_ray.serving.limits import Limits
from freemesh_ray.serving.parameters import ParameterError, parameters, value_types
from freemesh_ray.serving.queue import Busy, ShareTaken

#: Paths that are counted by name.
PATHS = ("/", MESH, "/health", "/metrics")

#: Seconds after which a client that was turned away may try again.
RETRY_AFTER = 1

#: Digits of a Content-Length that is worth reading.
DIGITS = 15


def digest(token: str) -> bytes:
    """The SHA-256 of a token, which is all that is kept of it."""
    return hashlib.sha256(token.encode()).digest()


def asgi_app(
    mesh: Callable[[MeshRequest], Coroutine[Any, Any, Answer]],
    able: Callable[[], int],
    *,
    densities: Sequence[str],
    limits: Limits,
    token: bytes | None,
    counters: Counters,
    hosts: Sequence[str] = (),
    pages: Sequence[str] = (),
) -> ASGIApp:
    """The ASGI application.

    Args:
        mesh: answers a request; raises `Busy`.
        able: how many meshers can take one.
        densities: that ``mesh`` has policies for.
        limits: of a request.
        token: digest of the bearer token that all paths but ``/health`` ask for; None: none is asked for.
        counters: where requests are counted.
        hosts: names that the server goes by beside those of this machine.
        pages: further ones, whose pages may use it.
    """
    endpoints = _Endpoints(mesh, able, densities, limits, counters)
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
    guarded = application if token is None else _Guarded(application, token)
    return _Counted(_OneLength(KnownHosts(guarded, hosts, pages)), counters)


class _Endpoints:
    """What the paths answer."""

    def __init__(
        self,
        mesh: Callable[[MeshRequest], Coroutine[Any, Any, Answer]],
        able: Callable[[], int],
        densities: Sequence[str],
        limits: Limits,
        counters: Counters,
    ) -> None:
        self._mesh, self._able, self._densities = mesh, able, densities
        self._limits, self._counters, self._uploads = limits, counters, 0

    async def mesh(self, request: Request) -> Response:
        """``POST /mesh``."""
        began = time.perf_counter()
        self._counters.began()
        try:
            return await self._meshed(request)
        finally:
            self._counters.ended(time.perf_counter() - began)

    async def _meshed(self, request: Request) -> Response:
        try:
            wanted = parameters(request.query_params.multi_items(), self._densities, self._limits)
        except ParameterError as error:
            raise Refused(HTTPStatus.BAD_REQUEST, str(error)) from None
        body = await self._body(request)
        asked = MeshRequest(body, wanted, client_address(request.client))
        try:
            answer = await _unless_left(request, self._mesh(asked))
        except ShareTaken:
            raise _busy("requests from your address have half of the queue, which is all that one may have") from None
        except Busy:
            raise _busy() from None
        headers = {}
        if answer.elements:
            self._counters.meshed(answer.elements)
            if wanted.format != JSON:
                headers["Content-Disposition"] = f'attachment; filename="{NAME}.{wanted.format}"'
        if answer.status == HTTPStatus.SERVICE_UNAVAILABLE:
            headers["Retry-After"] = str(RETRY_AFTER)
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
        body, large = bytearray(), False
        try:
            async with awake_timeout(self._limits.upload_seconds):
                async for chunk in request.stream():
                    body += chunk
                    if len(body) > most:
                        raise too_large
                    if len(body) > self._limits.quick_bytes and not large:
                        if self._uploads >= self._limits.uploads:
                            raise _busy()
                        self._uploads, large = self._uploads + 1, True
        except TimeoutError:
            line = f"body: not here after {self._limits.upload_seconds:g} s; send it at once"
            raise Refused(HTTPStatus.REQUEST_TIMEOUT, line) from None
        except ClientDisconnect:
            raise Refused(CLIENT_LEFT, "body: cut off") from None
        finally:
            self._uploads -= large
        return bytes(body)

    async def health(self, request: Request) -> Response:
        """``GET /health``: 200 when a mesh can be made."""
        able = self._able()
        status = HTTPStatus.OK if able else HTTPStatus.SERVICE_UNAVAILABLE
        return _json({"status": "ok" if able else "no mesher is running", "meshers": able}, status)

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
                unknown = error_response(HTTPStatus.UNAUTHORIZED, line, {"WWW-Authenticate": "Bearer"})
                await unknown(scope, receive, send)
                return
        await self._application(scope, receive, send)


class _OneLength:
    """Refuses a request that tells two lengths of its body: a proxy before this server may believe the other one."""

    def __init__(self, application: ASGIApp) -> None:
        self._application = application

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        names = {name for name, _ in scope["headers"]} if scope["type"] == "http" else set()
        if {b"content-length", b"transfer-encoding"} <= names:
            line = "body: Content-Length and Transfer-Encoding; send one of them"
            await error_response(HTTPStatus.BAD_REQUEST, line, {"Connection": "close"})(scope, receive, send)
        else:
            await self._application(scope, receive, send)


class _Counted:
    """Counts what is answered; what is cancelled because the server ends is answered, too."""

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
        except asyncio.CancelledError:
            if status == CLIENT_LEFT:
                ending = error_response(HTTPStatus.SERVICE_UNAVAILABLE, "the service ends; try another one", {})
                await ending(scope, receive, told)
        finally:
            self._counters.answered(scope["path"] if scope["path"] in PATHS else "other", status)


async def _unless_left(request: Request, work: Coroutine[Any, Any, Answer]) -> Answer:
    """What the work gives, unless the client leaves first.

    Raises:
        Refused: it did.
    """
    working, leaving = asyncio.ensure_future(work), asyncio.ensure_future(request.receive())
    try:
        await asyncio.wait({working, leaving}, return_when=asyncio.FIRST_COMPLETED)
        if not working.done():
            raise Refused(CLIENT_LEFT, "cut off")
        return working.result()
    finally:
        leaving.cancel()
        working.cancel()


def _busy(why: str = "all meshers are at work and the queue is full") -> HTTPException:
    line = f"busy: {why}; try again"
    return HTTPException(HTTPStatus.SERVICE_UNAVAILABLE, line, {"Retry-After": str(RETRY_AFTER)})


async def _refused(request: Request, refused: Exception) -> Response:
    """What is wrong with a request; where its body was not read to the end, the connection is of no more use."""
    assert isinstance(refused, Refused)
    unread = refused.status in (HTTPStatus.REQUEST_ENTITY_TOO_LARGE, HTTPStatus.REQUEST_TIMEOUT)
    return error_response(refused.status, str(refused), {"Connection": "close"} if unread else {})


async def _http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    headers = dict(error.headers or {})
    line = error.detail
    if error.status_code == HTTPStatus.NOT_FOUND:
        line = f"path: not known; there are {', '.join(PATHS)}"
    elif error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        allowed = ", ".join(sorted(headers.get("Allow", "").split(", ")))
        line = f"method {request.method}: not for this path; use {allowed}"
    return error_response(error.status_code, line, headers)


async def _mistake(request: Request, error: Exception) -> Response:
    """A mistake of ours: the log has it."""
    return error_response(HTTPStatus.INTERNAL_SERVER_ERROR, "the server made a mistake; its log says which", {})


def _json(value: object, status: int) -> Response:
    return Response(json.dumps(value).encode() + b"\n", status, media_type=MEDIA_TYPES[JSON])
