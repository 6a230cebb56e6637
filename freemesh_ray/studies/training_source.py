"""The source that decides what a training learns: digests of its packages' code, and versions of what they build on.

Digests are of the code as Python reads it, without comments and docstrings: a sentence, a document, a test, a report
or the server may change, and no training is repeated.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

#: Folders of the code that collects, learns and evaluates. What only meshes, draws, tracks or stores is not among them.
PACKAGES = ("envs", "freemesh_ray/algorithms", "freemesh_ray/config", "freemesh_ray/policies", "freemesh_ray/training")
#: Files of theirs that show what was learnt, or end a training.
OUTSIDE = (
    "envs/rendering/frame.py", "envs/rendering/window.py", "freemesh_ray/training/progress_line.py",
    "freemesh_ray/training/stage_meshes.py", "freemesh_ray/training/stop_signal.py",
)  # fmt: skip
#: Installed packages whose releases change what is learnt; builds of one release (``+cpu``) count as the same.
INSTALLED = ("ray", "torch", "gymnasium", "numpy", "numba")


@cache
def training_source() -> Mapping[str, str]:
    """Package -> digest of its code, or its version."""
    root = Path(__file__).parents[2]
    own = {package.replace("/", "."): digest(code_files(root, package), root) for package in PACKAGES}
    return own | {package: found for package in INSTALLED if (found := _release(package))}


def code_files(root: Path, package: str) -> list[Path]:
    """The files of a package that decide, sorted: its code, and the domains that it ships."""
    found = [path for suffix in ("*.py", "*.json") for path in (root / package).rglob(suffix)]
    return sorted(path for path in found if path.relative_to(root).as_posix() not in OUTSIDE)


def digest(files: Iterable[Path], root: Path) -> str:
    """Twelve hexadecimal digits of the files' names and contents; of Python's without comments and docstrings."""
    found = hashlib.sha256()
    for path in files:
        content = path.read_bytes()
        found.update(f"{path.relative_to(root).as_posix()}\0".encode())
        found.update(code(content) if path.suffix == ".py" else content)
    return found.hexdigest()[:12]


def code(content: bytes) -> bytes:
    """What a Python file does: its syntax tree without docstrings."""
    tree = ast.parse(content)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            node.body = [statement for statement in node.body if not _is_text(statement)]
    return ast.dump(tree).encode()


def _is_text(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)


def _release(package: str) -> str:
    """The release that is installed; empty where none is."""
    try:
        return version(package).partition("+")[0]
    except PackageNotFoundError:
        return ""
