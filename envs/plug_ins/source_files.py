"""The files that plug-ins stand in: which they are, and a digest of them."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from envs.plug_ins.search_path import findable


def top(spec: str, key: str) -> Path | None:
    """The file, or the folder, of a plug-in's outermost module; None where it has none.

    Raises:
        PluginError: there is no such module.
    """
    name = spec.partition(":")[0].partition(".")[0]
    found = findable(name, key, spec)
    if found is None or (found.origin in (None, "built-in", "frozen") and not found.submodule_search_locations):
        return None
    if found.submodule_search_locations:
        return Path(next(iter(found.submodule_search_locations)))
    return Path(str(found.origin))


def digest(specs: Sequence[str], key: str = "plug-ins") -> str:
    """A digest of the source of plug-ins: of each one's file, or of all files of its package.

    Raises:
        PluginError: there is no such module.
    """
    places = sorted({place for spec in specs if (place := top(spec, key)) is not None})
    files = [file for place in places for file in ([place] if place.is_file() else sorted(place.rglob("*.py")))]
    return hashlib.sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()
