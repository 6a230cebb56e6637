"""Plug-ins that tests write: a module in a folder of its own, forgotten at the end."""

from __future__ import annotations

import itertools
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

from envs.plug_ins import search_path
from freemesh_ray.config import ALGORITHMS, SCHEMA

_numbers = itertools.count()
#: The source of a module -> the module's name.
Write = Callable[[str], str]


@contextmanager
def modules(folder: Path) -> Iterator[Write]:
    """Write modules into ``folder``, where plug-ins are looked for meanwhile."""
    before, known = list(sys.path), set(sys.modules)

    def write(source: str) -> str:
        name = f"plugged_{os.getpid()}_{next(_numbers)}"
        (folder / f"{name}.py").write_text(source, encoding="utf-8")
        return name

    with patch.object(search_path, "_given", []), patch.dict(os.environ), patch.dict(ALGORITHMS), patch.dict(SCHEMA):
        search_path.look_in(folder)
        try:
            yield write
        finally:
            sys.path[:] = before
            for name in sys.modules.keys() - known:
                if name.startswith("plugged_"):
                    del sys.modules[name]
