"""Users and passwords of tracking stores: taken out of addresses as soon as these are read, and written down nowhere.

Of ``http://user:password@host`` settings keep ``http://host``. The rest is kept in an environment variable of this
process, which the processes that it starts inherit; it is given back to that address, and to no other.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping

from envs.printable import without_login

#: Addresses and their ``user:password``, as JSON.
LOGINS = "FREEMESH_TRACKING_LOGINS"


def set_aside(uri: str) -> str:
    """The address without its user and password, which this process remembers."""
    bare = without_login(uri)
    if bare != uri:
        login = uri.partition("://")[2].removesuffix(bare.partition("://")[2]).removesuffix("@")
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
