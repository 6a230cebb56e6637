"""A tree of plain values and arrays in one file, without pickle: reading it runs nothing that the file says.

The file is a zip archive of ``.npy`` arrays (an ``.npz``) and ``tree.json``, which holds the rest and says where the
arrays belong. JSON knows neither tuples nor arrays nor keys other than text; these are written as one-entry objects:
``{"tuple": [...]}``, ``{"array": 3}``, ``{"dict": [[key, value], ...]}``. Zip's check sums tell a file that was cut
short or changed from a whole one.
"""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from freemesh_ray.storage import free_memory, regular_file
from freemesh_ray.storage.array_archive import KINDS, array_in
from freemesh_ray.storage.zip_archive import DAMAGES, opened

TREE = "tree.json"
#: Bytes of the tree at most (those of trainings have 20,000), and entries of one dict.
MOST_TREE, MOST_ENTRIES = 4_000_000, 10_000
#: What reading a file that was cut short or changed raises.
DAMAGE = (*DAMAGES, KeyError, ValueError, TypeError, OverflowError, MemoryError)


class StateFileError(ValueError):
    """A file that holds no tree, or not all of it."""


def save(state: Any, path: Path) -> None:
    """Write ``state`` to ``path`` and to the disk.

    Args:
        state: nested dicts (keys: text, numbers or None), lists and tuples of None, booleans, numbers, text and arrays.
            Named tuples become tuples, NumPy's scalars numbers.
        path: of the file; what is there, a link too, is removed first.

    Raises:
        TypeError: something else is in it.
        OSError: it cannot be written.
    """
    arrays: list[np.ndarray] = []
    tree = _described(state, arrays)
    path.unlink(missing_ok=True)
    with open(path, "xb") as file:
        with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
            for i, array in enumerate(arrays):
                with archive.open(f"{i}.npy", "w", force_zip64=True) as entry:
                    np.lib.format.write_array(entry, array, allow_pickle=False)
            archive.writestr(TREE, json.dumps(tree))
        file.flush()
        os.fsync(file.fileno())


def load(path: Path) -> Any:
    """What ``save`` wrote; no more memory is taken than twice the file's size, and a hundred bytes a byte of the tree.

    Raises:
        StateFileError: it is no such file, or it is damaged.
        MemoryShortError: memory has no room for what it holds.
        OSError: it cannot be read.
    """
    try:
        file = regular_file.opened(path)
    except ValueError as error:
        raise StateFileError(f"{path}: is {error}") from error
    try:
        with file, opened(file, os.fstat(file.fileno()).st_size) as archive:
            members = archive.infolist()
            if any(member.compress_type != zipfile.ZIP_STORED for member in members):
                raise ValueError("packed, which state files are not")
            if archive.getinfo(TREE).file_size > MOST_TREE:
                raise ValueError(f"{TREE} has more than {MOST_TREE:,} bytes")
            free_memory.check(2 * sum(member.file_size for member in members), f"{path}: it")
            tree = json.loads(archive.read(TREE))
            names = {int(name.removesuffix(".npy")): name for name in archive.namelist() if name != TREE}
            arrays = {i: array_in(archive.read(name)).copy() for i, name in names.items()}  # all of it, checked
        return _restored(tree, arrays)
    except DAMAGE as error:
        brief = (str(error) or type(error).__name__).splitlines()[0][:120]
        raise StateFileError(f"{path}: damaged ({brief})") from error


def _described(node: Any, arrays: list[np.ndarray]) -> Any:
    if isinstance(node, np.generic):
        node = node.item()
    if node is None or isinstance(node, bool | int | float | str):
        return node
    if isinstance(node, np.ndarray) and node.dtype.kind in KINDS:
        arrays.append(node)
        return {"array": len(arrays) - 1}
    if isinstance(node, Mapping):
        return {"dict": [[_described(key, arrays), _described(value, arrays)] for key, value in node.items()]}
    if isinstance(node, list | tuple):
        items = [_described(item, arrays) for item in node]
        return items if isinstance(node, list) else {"tuple": items}
    raise TypeError(f"{type(node).__name__}: not something that a state file holds")


def _restored(node: Any, arrays: Mapping[int, np.ndarray]) -> Any:
    if isinstance(node, list):
        return [_restored(item, arrays) for item in node]
    if not isinstance(node, dict):
        return node
    ((kind, content),) = node.items()
    if kind == "array":
        return arrays[content]
    if kind == "tuple":
        return tuple(_restored(item, arrays) for item in content)
    if kind == "dict":
        if len(content) > MOST_ENTRIES:  # crafted keys make a dict take time with the square of their number
            raise ValueError(f"a dict of more than {MOST_ENTRIES:,} entries")
        return {_restored(key, arrays): _restored(value, arrays) for key, value in content}
    raise ValueError(f"unknown kind {kind!r}")
