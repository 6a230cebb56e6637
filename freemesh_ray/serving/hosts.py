"""Whom a request is for, and from which page: what keeps web pages from using a server on their reader's machine.

A page can send requests to 127.0.0.1, and one whose own name leads there (DNS rebinding) can read the answers. The
browser tells both: the name in ``Host``, the page in ``Origin``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from http import HTTPStatus
from ipaddress import ip_address

from starlette.types import ASGIApp, Receive, Scope, Send

from freemesh_ray.serving.errors import error_response

#: Names of this machine, whatever it listens on.
LOCAL = ("localhost", "127.0.0.1", "::1")

#: The last port that there is.
LAST_PORT = 65535

#: A host, or an address of version 6 in brackets, and a port.
AUTHORITY = re.compile(r"(?:\[([0-9a-fA-F:.]+)\]|([^\[\]:/?#@\s]+))(:\d{0,5})?")


class KnownHosts:
    """Answers 403 to requests that are for another host, or from another host's page."""

    def __init__(self, application: ASGIApp, names: Iterable[str], pages: Iterable[str] = ()) -> None:
        """Wrap an application.

        Args:
            application: that has to be protected.
            names: hosts that it goes by beside those of this machine.
            pages: further ones, by which a proxy before it is known; their pages, at the usual port, may use it, too.
        """
        self._application, self._pages = application, frozenset(normal(name) for name in pages)
        self._names = self._pages | {normal(name) for name in (*names, *LOCAL)}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and (line := self.mistaken(scope)):
            await error_response(HTTPStatus.FORBIDDEN, line, {})(scope, receive, send)
        else:
            await self._application(scope, receive, send)

    def mistaken(self, scope: Scope) -> str:
        """Why a request is refused, if it is."""
        hosts = [value.decode("latin-1") for name, value in scope["headers"] if name == b"host"]
        origins = [value.decode("latin-1") for name, value in scope["headers"] if name == b"origin"]
        # The address that was connected to is no name that could lead somewhere else. Without any name, it is HTTP/1.0
        # and no browser.
        here = {normal(str(scope["server"][0]))} if scope.get("server") else set()
        if not all(named(host) in self._names | here for host in hosts):
            return "host: not a name of this server; use --allowed-hosts to have more"
        for origin in origins:
            # What another port of the same host shows is another server's page.
            scheme, _, authority = origin.partition("://")
            if (
                not authority
                or scheme not in ("http", "https")
                or (authority not in hosts and named(authority, usual_port=True) not in self._pages)
            ):
                return "origin: another server's page; use --allowed-hosts to let its pages use this server"
        return ""


def named(authority: str, usual_port: bool = False) -> str | None:
    """The name in a host and port; None where there is none, or where it has a port and must not."""
    found = AUTHORITY.fullmatch(authority)
    if found is None or (usual_port and found[3]) or int((found[3] or "")[1:] or 0) > LAST_PORT:
        return None
    return normal(found[1] or found[2])


def normal(name: str) -> str:
    """A name, or an address, as it is compared."""
    try:
        address = ip_address(name.strip("[]"))
        return str(getattr(address, "ipv4_mapped", None) or address)
    except ValueError:
        return name.lower().rstrip(".")
