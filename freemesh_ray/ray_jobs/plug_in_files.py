"""Plug-ins that a job needs and the checkout does not bring: what Ray uploads beside it."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sysconfig
from collections.abc import Sequence
from pathlib import Path

from envs.plug_ins.source_files import top
from freemesh_ray.storage.atomic import replacing


def beside(specs: Sequence[str], checkout: Path, excludes: Sequence[str]) -> list[str]:
    """Folders of the modules of plug-ins, to be uploaded as ``py_modules``.

    Ray's jobs take no single file: one is copied into a package of its name in the user's cache, where it stays, so
    that a line which is printed can be run. Left out are modules that the checkout's upload has at its root, and
    installed ones, which the cluster's nodes must have as they have this package.

    Args:
        specs: ``package.module:Name`` each.
        checkout: what is uploaded, but for what .gitignore names.
        excludes: patterns as in .gitignore, of what is left out besides.

    Raises:
        PluginError: there is no such module.
        OutputError: a file cannot be copied.
    """
    installed = [Path(sysconfig.get_path(name)).resolve() for name in ("stdlib", "purelib", "platlib")]
    found = dict.fromkeys(place.resolve() for spec in specs if (place := top(spec, "plug-in")) is not None)
    return [
        str(place if place.is_dir() else _as_package(place))
        for place in found
        if not any(place.is_relative_to(folder) for folder in installed)
        and not (place.parent == checkout.resolve() and _uploaded(place, excludes))
    ]


def _as_package(file: Path) -> Path:
    """A folder that is imported as ``file`` is, called after its contents."""
    content = file.read_bytes()
    cache = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser()
    folder = cache / "freemesh" / "plug_ins" / hashlib.sha256(content).hexdigest()[:16] / file.stem
    with replacing(folder / "__init__.py") as draft:
        draft.write_bytes(content)
    return folder


def _uploaded(place: Path, excludes: Sequence[str]) -> bool:
    """Whether a file or folder at the checkout's root goes with it."""
    if place.name in {pattern.strip("/") for pattern in excludes}:
        return False
    try:
        line = ["git", "check-ignore", "--quiet", "--no-index", str(place)]
        return subprocess.run(line, cwd=place.parent, capture_output=True, timeout=10).returncode != 0
    except (OSError, subprocess.SubprocessError):
        return True
