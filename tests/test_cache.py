"""The kernels' cache: a folder named after all kernel code, so that it is never stale."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path

import pytest

import envs

PACKAGE = Path(envs.__file__).parent
KERNELS = sorted(
    str(path.relative_to(PACKAGE))
    for path in PACKAGE.rglob("*.py")
    if any(line in ("@compiled", "@inlined") for line in path.read_text(encoding="utf-8").splitlines())
)


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the package's sources."""
    return Path(shutil.copytree(PACKAGE, tmp_path / "envs", ignore=shutil.ignore_patterns("__pycache__", "domains")))


def folder_of(package: Path) -> Path:
    """The cache folder that a package's ``compiled.py`` chooses; nothing is compiled."""
    spec = importlib.util.spec_from_file_location("copied", package / "kernels" / "compiled.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return Path(module._cache_folder())


def append(path: Path, text: str) -> None:
    path.write_text(path.read_text(encoding="utf-8") + text, encoding="utf-8")


def test_there_are_kernels_in_many_files() -> None:
    assert {"front.py", "action.py", "observation.py", "transition.py"} < set(KERNELS)
    assert {str(Path("kernels", name)) for name in ("geometry.py", "slot_tree.py")} < set(KERNELS)


@pytest.mark.parametrize("name", [*KERNELS, "types.py", str(Path("kernels", "compiled.py"))])
def test_a_change_of_kernel_code_is_a_new_folder(copy: Path, name: str) -> None:
    before = folder_of(copy)
    assert before == folder_of(copy), "the same code, the same folder"
    append(copy / name, "\n# changed\n")
    after = folder_of(copy)
    assert after != before
    assert after.parent == before.parent == copy / "__pycache__"


def test_a_change_elsewhere_keeps_the_folder(copy: Path) -> None:
    before = folder_of(copy)
    append(copy / "render.py", "\n# changed\n")
    (copy / "more.py").write_text("x = 1\n", encoding="utf-8")
    assert folder_of(copy) == before


def test_a_new_kernel_file_is_a_new_folder(copy: Path) -> None:
    before = folder_of(copy)
    (copy / "more.py").write_text("from envs.kernels.compiled import compiled\n", encoding="utf-8")
    assert folder_of(copy) != before


def test_the_same_code_elsewhere_has_the_same_name(copy: Path) -> None:
    assert folder_of(copy).name == folder_of(PACKAGE).name
