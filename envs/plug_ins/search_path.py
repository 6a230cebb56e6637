"""Where plug-ins are looked for: where Python looks, then in the folders that were given."""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path

from envs.errors import PluginError

#: The variable that tells processes started from here in which folders plug-ins were found.
FOLDERS = "FREEMESH_PLUG_INS"

#: Folders of `look_in`, in order.
_given: list[str] = []


def look_in(folder: str | Path) -> None:
    """Look for plug-ins in a folder, too, after all others."""
    path = str(Path(folder).expanduser().absolute())
    if path not in _given:
        _given.append(path)


def folders() -> tuple[str, ...]:
    """The folders of `look_in`, and those of the process that started this one."""
    inherited = [folder for folder in os.environ.get(FOLDERS, "").split(os.pathsep) if folder]
    return tuple(dict.fromkeys([*inherited, *_given]))


def findable(name: str, key: str, spec: str) -> ModuleSpec | None:
    """The outermost module of a plug-in, which Python can import from here on; None where it is imported already and
    says nothing of itself.

    Raises:
        PluginError: there is none.
    """
    if name in sys.modules:
        return sys.modules[name].__spec__
    importlib.invalidate_caches()
    if (found := importlib.util.find_spec(name)) is not None:
        return found
    for folder in folders():
        if (found := PathFinder.find_spec(name, [folder])) is not None:
            sys.path.append(folder)  # last: it hides nothing
            known = os.environ.get(FOLDERS, "").split(os.pathsep)
            os.environ[FOLDERS] = os.pathsep.join(dict.fromkeys([*filter(None, known), folder]))
            return found
    where = _given[0] if _given else os.getcwd()
    raise PluginError(f"{key}: {spec}: no module {name}: put {name}.py into {where}, or set PYTHONPATH to its folder")
