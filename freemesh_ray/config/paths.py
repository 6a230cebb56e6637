"""Where runs, studies and the tracking store lie: relative paths of a configuration become absolute once, at its start.

FREEMESH_HOME         the folder that relative ``paths.runs``, ``paths.studies`` and ``sqlite:///file`` are below;
                      unset, it is the current folder, and ``~/freemesh`` in a job of a Ray cluster, whose current
                      folder is a copy that goes with it
MLFLOW_TRACKING_URI   the tracking store where ``tracking.uri`` is null; unset, it is ``sqlite:///mlflow.db``; a user
                      and a password in it are for this process and those that it starts alone

A FILE in ``sqlite:///FILE`` is its plain name: ``%20`` and ``?`` in it stand for themselves.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from freemesh_ray.config import SCHEMA, check
from freemesh_ray.config.schema import FOLDER
from freemesh_ray.config.store_login import set_aside

HOME, STORE = "FREEMESH_HOME", "MLFLOW_TRACKING_URI"
#: Ray sets it for the driver of a job, and for nothing else.
JOB = "RAY_JOB_CONFIG_JSON_ENV_VAR"
SQLITE = "sqlite:///"


@dataclass(frozen=True)
class Paths:
    """What the paths of a configuration are relative to, read from this process's environment variables once.

    Attributes:
        home: an absolute folder; it need not exist.
        store: the tracking store of configurations that name none.
    """

    home: Path
    store: str

    @classmethod
    def from_environment(cls, home: str = "") -> Self:
        """What ``FREEMESH_HOME`` and ``MLFLOW_TRACKING_URI`` say, else the defaults above.

        Args:
            home: in place of the default one.

        Raises:
            ConfigError: FREEMESH_HOME is a URL.
        """
        given = os.environ.get(HOME) or home or ("~/freemesh" if JOB in os.environ else "")
        check(given or ".", FOLDER, HOME, "the home")
        return cls(Path(given).expanduser().absolute(), os.environ.get(STORE) or f"{SQLITE}mlflow.db")

    def resolved(self, config: Mapping[str, Any]) -> dict[str, Any]:
        """The tree with a tracking store and absolute paths; resolving it again changes nothing.

        The store's user and password are no part of it: this process remembers them (`store_login`).

        Raises:
            ConfigError: ``MLFLOW_TRACKING_URI`` is no store that can be tracked to.
        """
        tracking, paths = config["tracking"], config["paths"]
        uri = set_aside(tracking["uri"] or "") or check(
            set_aside(self.store), SCHEMA["tracking.uri"], STORE, "tracking.uri"
        )
        if uri.startswith(SQLITE):
            uri = f"{SQLITE}{self.home / uri.removeprefix(SQLITE)}"
        return {
            **config,
            "tracking": {**tracking, "uri": uri},
            "paths": {key: str(self.home / path) for key, path in paths.items()},
        }


def elsewhere(key: str) -> str:
    """The fix for a folder of ``paths`` that cannot be used, ``key`` as ``paths.runs``."""
    return f"set {HOME}, or {key}, to another place"


def pasted(path: str | Path) -> str:
    """A path as it can be pasted into a shell in the current folder."""
    return shlex.quote(shown(path))


def shown(path: str | Path) -> str:
    """A path, or a store, as short as it can be typed in the current folder."""
    text = str(path)
    scheme = SQLITE if text.startswith(SQLITE) else ""
    full = Path(text.removeprefix(scheme))
    return f"{scheme}{full.relative_to(Path.cwd())}" if full.is_relative_to(Path.cwd()) else text
