"""docs/how-it-works.md draws the layers that import-linter checks: the same names on the same floors, top to bottom."""

from __future__ import annotations

import re
import tomllib

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


@pytest.mark.parametrize("package", CONTRACTS)
def test_the_drawing_shows_the_layers_that_are_checked(package: str) -> None:
    assert drawn(package) == checked(package)


def test_few_files_lie_beside_the_packages_of_the_meshing_world() -> None:
    assert len(list((ROOT / "envs").glob("*.py"))) <= LOOSE
