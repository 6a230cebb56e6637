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

from freemesh_ray.storage.array_archive import DAMAGES, KINDS, array_in

TREE = "tree.json"
#: What reading a file that was cut short or changed raises.
DAMAGE = (*DAMAGES, KeyError, ValueError, TypeError, OverflowError, MemoryError)


class StateFileError(ValueError):
    """A file that holds no tree, or not all of it."""


def save(state: Any, path: Path) -> None:
    """Write ``state`` to ``path`` and to the disk.

    Args:
        state: nested dicts (keys: text, numbers or None), lists and tuples of None, booleans, numbers, text and arrays.
            Named tuples become tuples, NumPy's scalars numbers.
        path: of a new file.

    Raises:
        TypeError: something else is in it.
        OSError: it cannot be written.
    """
    arrays: list[np.ndarray] = []
    tree = _described(state, arrays)
    with open(path, "wb") as file:
        with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as archive:
            for i, array in enumerate(arrays):
                with archive.open(f"{i}.npy", "w", force_zip64=True) as entry:
                    np.lib.format.write_array(entry, array, allow_pickle=False)
            archive.writestr(TREE, json.dumps(tree))
        file.flush()
        os.fsync(file.fileno())


def load(path: Path) -> Any:
    """What ``save`` wrote.

    Raises:
        StateFileError: it is no such file, or it is damaged.
        OSError: it cannot be read.
    """
    file = open(path, "rb")  # noqa: SIM115  what goes wrong here is no damage
    try:
        with file, zipfile.ZipFile(file) as archive:
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
        return {_restored(key, arrays): _restored(value, arrays) for key, value in content}
    raise ValueError(f"unknown kind {kind!r}")
