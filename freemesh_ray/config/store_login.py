"""Users and passwords of tracking stores: taken out of addresses as soon as these are read, and written down nowhere.

Of ``http://user:password@host`` settings keep ``http://host``. The rest is kept in an environment variable of this
process, which the processes that it starts inherit; it is given back to that address, and to no other.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping

#: User, password, host and port of an address, behind ``://``.
HOST = re.compile(r"[^/?#\\]+")

#: Kinds of addresses that have none of these.
FILES = ("sqlite", "file")

#: Addresses and their ``user:password``, as JSON.
LOGINS = "FREEMESH_TRACKING_LOGINS"


def set_aside(uri: str) -> str:
    """The address without its user and password, which this process remembers.

    They stand before the host: an ``@`` behind it is left where it is, and no address of a store is taken that has one.
    """
    scheme, _, rest = uri.partition("://")
    before = HOST.match(rest)
    if before is None or scheme in FILES:
        return uri
    login, at, host = before[0].rpartition("@")
    if not at:
        return uri
    bare = f"{scheme}://{host}{rest[before.end() :]}"
    remember({_key(bare): login})
    return bare


def with_login(uri: str) -> str:
    """The address with the user and password that were set aside from it, if there were any."""
    login = known().get(_key(uri))
    scheme, _, rest = uri.partition("://")
    return f"{scheme}://{login}@{rest}" if login else uri


def known() -> dict[str, str]:
    """What was set aside, to be handed to other processes by `remember`."""
    try:
        found = json.loads(os.environ.get(LOGINS, "{}"))
    except ValueError:
        return {}
    return {str(key): str(value) for key, value in found.items()} if isinstance(found, dict) else {}


def remember(logins: Mapping[str, str]) -> None:
    """Know what another process knows, too."""
    if logins:
        os.environ[LOGINS] = json.dumps({**known(), **logins})


def _key(uri: str) -> str:
    return uri.rstrip("/")
