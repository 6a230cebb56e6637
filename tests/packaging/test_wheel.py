"""The wheel: what is in it, and that it works where there is no checkout."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from dataclasses import dataclass
from pathlib import Path

import pytest
from checkout import ROOT, files
from processes import outside

pytestmark = pytest.mark.slow
#: What of the checkout is installed; of `freemesh_ray` and the others everything that is no Python file, too.
PACKAGES = ("envs", "freemesh_ray", "tune_configs")
DEADLINE = 600


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built of the files that a clone has, beside the checkout, so that nothing is left in it."""
    source, built = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in files():
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, source / name)
    pip("wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(built), str(source))
    (path,) = built.iterdir()
    return path


def pip(*arguments: str) -> None:
    line = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet", "--no-input", *arguments]
    done = subprocess.run(line, capture_output=True, text=True, timeout=DEADLINE)
    assert done.returncode == 0, done.stderr


@dataclass(frozen=True)
class Installed:
    """An environment with the wheel and this environment's other packages; the checkout cannot be imported."""

    python: Path
    packages: Path
    folder: Path

    def run(self, *arguments: str) -> str:
        """What Python prints on stdout, in a folder that has nothing but an example."""
        kept = {
            key: value for key, value in outside().items() if not key.startswith(("PYTHON", "FREEMESH_", "MLFLOW_"))
        }
        done = subprocess.run(
            [self.python, *arguments], cwd=self.folder, env=kept, capture_output=True, text=True, timeout=DEADLINE
        )
        assert done.returncode == 0, done.stderr
        return done.stdout


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Installed:
    place = tmp_path_factory.mktemp("environment")
    venv.create(place, symlinks=True)
    python = place / "bin" / "python"
    packages = Path(sysconfig.get_path("purelib", vars={"base": str(place)}))
    pip("--python", str(python), "install", "--no-deps", "--no-index", str(wheel))
    # A folder that a .pth names is searched, but its own .pth are not read: those of an editable installation.
    others = dict.fromkeys(sysconfig.get_path(name) for name in ("purelib", "platlib"))
    (packages / "others.pth").write_text("".join(f"{path}\n" for path in others))
    folder = tmp_path_factory.mktemp("elsewhere")
    shutil.copy(ROOT / "docs/examples/part.geojson", folder)
    return Installed(python, packages, folder)


def test_the_wheel_holds_the_packages_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        held = set(archive.namelist())
    about = {name for name in held if name.partition("/")[0].endswith(".dist-info")}
    assert held - about == {name for name in files() if name.split("/")[0] in PACKAGES}
    assert any(name.endswith("licenses/LICENSE") for name in about)
    assert held >= {
        "envs/py.typed", "envs/domains/catalogue/T1.json", "envs/domains/catalogue/T1.svg",
        "freemesh_ray/py.typed", "freemesh_ray/plots/replay.html", "freemesh_ray/policies/medium.npz",
        "freemesh_ray/paper_tables/published.yaml", "tune_configs/defaults.yaml",
    }  # fmt: skip


def test_what_is_imported_is_the_wheel_s(installed: Installed) -> None:
    told = installed.run("-c", f"import {', '.join(PACKAGES)}\nfor one in ({', '.join(PACKAGES)}): print(one.__file__)")
    assert [Path(line).parent.parent for line in told.split()] == [installed.packages] * len(PACKAGES)
    assert "ModuleNotFoundError" in installed.run(
        "-c", "try: import tests\nexcept ModuleNotFoundError as error: print(repr(error))"
    )


def test_commands_that_read_data_work(installed: Installed) -> None:
    assert installed.run("-m", "freemesh_ray", "--version").startswith("freemesh-ray ")
    assert "T1" in installed.run("-m", "freemesh_ray", "domains")
    assert "algorithms" in installed.run("-m", "freemesh_ray", "study")
    assert str(installed.folder) in installed.run("-m", "freemesh_ray", "study", "algorithms", "--dry-run")
    assert os.access(installed.python.with_name("freemesh"), os.X_OK)


def test_it_meshes(installed: Installed) -> None:
    """With kernels of its own, which are compiled."""
    written = [installed.folder / f"part.{ending}" for ending in ("inp", "html", "png")]
    outputs = [word for path in written for word in ("-o", path.name)]
    assert "quads" in installed.run("-m", "freemesh_ray", "mesh", "part.geojson", *outputs)
    assert all(path.stat().st_size > 1000 for path in written)
