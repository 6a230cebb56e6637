"""The kernels' cache: a folder for each package, named after all kernel code it can call, so that it is never stale."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

import envs
import freemesh_ray
from envs.mdp.front import _index
from freemesh_ray.mesher.engine import run

PACKAGE = Path(envs.__file__).parent
PLATFORM = Path(freemesh_ray.__file__).parent

DECORATORS = ("@compiled", "@compiled_fused", "@inner", "@inner_fused", "@inlined")


def kernels(package: Path) -> list[str]:
    """The files of a package that define kernels."""
    return sorted(
        str(path.relative_to(package))
        for path in package.rglob("*.py")
        if any(line in DECORATORS for line in path.read_text(encoding="utf-8").splitlines())
    )


KERNELS, PLATFORM_KERNELS = kernels(PACKAGE), kernels(PLATFORM)


def copied(package: Path, parent: Path) -> Path:
    """A copy of a package's sources."""
    ignored = shutil.ignore_patterns("__pycache__", "catalogue")
    return Path(shutil.copytree(package, parent / package.name, ignore=ignored))


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the package's sources."""
    return copied(PACKAGE, tmp_path)


@pytest.fixture
def platform(copy: Path) -> Path:
    """A copy of the platform's sources, beside that of the package it builds on."""
    return copied(PLATFORM, copy.parent)


def folder_of(base: Path, package: Path | None = None) -> Path:
    """The cache folder that ``base``'s ``jit.py`` chooses for a package; nothing is compiled."""
    spec = importlib.util.spec_from_file_location("copied", base / "kernels" / "jit.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return Path(module.cache_folder(package or base))


def append(path: Path, text: str) -> None:
    path.write_text(path.read_text(encoding="utf-8") + text, encoding="utf-8")


def test_there_are_kernels_in_many_files() -> None:
    assert {str(Path("mdp", name)) for name in ("front.py", "action.py", "observation.py", "transition.py")} < set(
        KERNELS
    )
    assert {str(Path("kernels", name)) for name in ("geometry.py", "slot_tree.py")} < set(KERNELS)


def test_the_platform_has_kernels_too() -> None:
    assert str(Path("mesher", "engine.py")) in PLATFORM_KERNELS


@pytest.mark.parametrize("name", PLATFORM_KERNELS)
def test_a_change_of_the_platform_s_kernels_is_its_own_new_folder(copy: Path, platform: Path, name: str) -> None:
    before, base_before = folder_of(copy, platform), folder_of(copy)
    append(platform / name, "\n# changed\n")
    after = folder_of(copy, platform)
    assert after != before
    assert after.parent == platform / "__pycache__"
    assert folder_of(copy) == base_before


@pytest.mark.parametrize("name", KERNELS)
def test_a_change_of_the_kernels_below_is_a_new_folder_for_the_platform(copy: Path, platform: Path, name: str) -> None:
    before = folder_of(copy, platform)
    append(copy / name, "\n# changed\n")
    assert folder_of(copy, platform) != before


@pytest.mark.parametrize("name", ["policies/policy.py", "bench/sampling.py", "algorithms/sac.py"])
def test_a_change_elsewhere_on_the_platform_keeps_its_folder(copy: Path, platform: Path, name: str) -> None:
    before = folder_of(copy, platform)
    append(platform / name, "\n# changed\n")
    assert folder_of(copy, platform) == before


@pytest.mark.skipif(bool(os.environ.get("NUMBA_CACHE_DIR")), reason="the cache is elsewhere by choice")
@pytest.mark.parametrize(("kernel", "package"), [(_index, PACKAGE), (run, PLATFORM)])
def test_machine_code_lies_with_its_package(kernel: Any, package: Path) -> None:
    assert Path(kernel.stats.cache_path).is_relative_to(folder_of(PACKAGE, package))


@pytest.mark.parametrize("name", [*KERNELS, "types.py", str(Path("kernels", "jit.py"))])
def test_a_change_of_kernel_code_is_a_new_folder(copy: Path, name: str) -> None:
    before = folder_of(copy)
    assert before == folder_of(copy), "the same code, the same folder"
    append(copy / name, "\n# changed\n")
    after = folder_of(copy)
    assert after != before
    assert after.parent == before.parent == copy / "__pycache__"


def test_a_change_elsewhere_keeps_the_folder(copy: Path) -> None:
    before = folder_of(copy)
    append(copy / "rendering" / "frame.py", "\n# changed\n")
    (copy / "more.py").write_text("x = 1\n", encoding="utf-8")
    assert folder_of(copy) == before


def test_a_new_kernel_file_is_a_new_folder(copy: Path) -> None:
    before = folder_of(copy)
    (copy / "more.py").write_text("from envs.kernels.jit import compiled\n", encoding="utf-8")
    assert folder_of(copy) != before


@pytest.mark.slow
def test_a_copy_elsewhere_finds_the_machine_code(copy: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Compiled from one place, the kernel is loaded, not compiled, from another."""
    script = """
from envs.quality import _element_quality, element_quality
element_quality([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2, 3]])
print(len(_element_quality.stats.cache_hits))
"""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    hits = []
    for parent in (copy.parent, PACKAGE.parent):
        run = [sys.executable, "-c", script]
        hits.append(subprocess.check_output(run, cwd=parent, env={**os.environ, "PYTHONPATH": ""}, text=True).strip())
    assert hits == ["0", "1"]


def test_the_same_code_elsewhere_has_the_same_name(copy: Path) -> None:
    assert folder_of(copy).name == folder_of(PACKAGE).name


def test_a_place_that_cannot_be_written_to_is_left_alone(
    copy: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "cache"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    assert folder_of(copy).is_relative_to(tmp_path / "temporary")


@pytest.mark.parametrize("place", ["open to all", "a link", "a file", "of another", "nowhere"])
def test_machine_code_that_others_could_have_put_there_is_not_run(
    place: str, copy: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "cache"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / ("none" if place == "nowhere" else "")))
    folder = tmp_path / f"freemesh-kernels-{os.getuid()}"
    (tmp_path / "theirs").mkdir()
    if place == "a link":
        folder.symlink_to(tmp_path / "theirs")
    elif place == "a file":
        folder.touch()
    elif place != "nowhere":
        folder.mkdir()
        folder.chmod(0o777 if place == "open to all" else 0o700)
    if place == "of another":
        if os.geteuid():
            pytest.skip("only root can give a folder away")
        os.chown(folder, 65534, 65534)
    assert folder_of(copy).parent == Path(os.devnull)
