"""docs/how-it-works.md draws the layers that import-linter checks: the same names on the same floors, top to bottom."""

from __future__ import annotations

import ast
import re
import tomllib
from pathlib import Path

import pytest
from checkout import ROOT
from documents import blocks

#: By package, the contract that holds its layers.
CONTRACTS = {"freemesh_ray": "the floors of the platform", "envs": "the floors of the meshing world"}
#: Files beside the packages of `envs` at most.
LOOSE = 8


def floors(names: list[str]) -> list[set[str]]:
    """Of each floor the names on it, from ``"a | b"``."""
    return [{name.strip() for name in floor.split("|")} for floor in names]


def drawn(package: str) -> list[set[str]]:
    """The floors of a package in the drawing: below its name, indented, names to the left of two blanks."""
    (drawing,) = (block.text for block in blocks("docs/how-it-works.md") if block.text.startswith("freemesh_ray\n"))
    below = re.search(rf"^{package}\n((?:  .*\n?)+)", drawing, re.MULTILINE)
    assert below is not None
    return floors([re.split(r"\s{2,}", line.strip())[0] for line in below[1].splitlines()])


def checked(package: str) -> list[set[str]]:
    """The floors of a package that import-linter checks."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    (contract,) = (each for each in contracts if each["name"] == CONTRACTS[package])
    return floors(contract["layers"])


def package_of(path: Path) -> str:
    """The package that a file or a folder of this checkout is in."""
    return ".".join((path if path.is_dir() else path.parent).relative_to(ROOT).parts)


def arrows() -> set[tuple[str, str]]:
    """Pairs of packages of which a file of the first imports from the second."""
    found = set()
    for path in (path for package in CONTRACTS for path in (ROOT / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import | ast.ImportFrom) else []
            for name in names:
                full = f"{node.module}.{name}" if isinstance(node, ast.ImportFrom) else name
                place = ROOT / full.replace(".", "/")
                while not place.is_dir():
                    place = place.parent
                if package_of(place).split(".")[0] in CONTRACTS:
                    found.add((package_of(path), package_of(place)))
    return {(a, b) for a, b in found if a != b}


@pytest.mark.parametrize("package", CONTRACTS)
def test_the_drawing_shows_the_layers_that_are_checked(package: str) -> None:
    assert drawn(package) == checked(package)


def test_few_files_lie_beside_the_packages_of_the_meshing_world() -> None:
    assert len(list((ROOT / "envs").glob("*.py"))) <= LOOSE


@pytest.mark.slow
def test_the_packages_and_the_imports_between_them_are_about_as_many_as_the_page_says() -> None:
    said = re.search(r"(\d+) packages, with about (\d+) imports", (ROOT / "docs" / "how-it-works.md").read_text())
    assert said is not None
    packages = {path.parent for package in CONTRACTS for path in (ROOT / package).rglob("__init__.py")}
    assert len(packages) == int(said[1])
    assert len(arrows()) == pytest.approx(int(said[2]), rel=0.05)
