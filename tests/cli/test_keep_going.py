"""``--keep-going``: one bad polygon of many stops nothing; what is left out is told, and the exit code is 1."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from envs.mesh import Mesh as PlainMesh
from envs.types import Domain
from freemesh_ray.cli import command as cli
from freemesh_ray.mesher import MeshingError, MeshResult, polygon_to_mesh
from freemesh_ray.policies.policy import Policy

SQUARE = [(0, 0), (1, 0), (2, 0), (2, 1), (2, 2), (1, 2), (0, 2), (0, 1)]
BOW = [(0, 0), (2, 2), (2, 0), (0, 2)]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def file_of(rings: list[list[tuple[float, float]]], more: str = "") -> str:
    texts = [", ".join(f"{x} {y}" for x, y in [*ring, ring[0]]) for ring in rings]
    polygons = ", ".join(f"POLYGON(({text}))" for text in texts)
    Path("part.wkt").write_text(f"GEOMETRYCOLLECTION({polygons}{more})")
    return "part.wkt"


def moved(ring: list[tuple[float, float]], by: float) -> list[tuple[float, float]]:
    return [(x + by, y) for x, y in ring]


def test_a_bad_polygon_does_not_stop_the_others(capsys: pytest.CaptureFixture[str]) -> None:
    """Whose files keep the numbers that they have in the file."""
    path = file_of([SQUARE, moved(BOW, 10), moved(SQUARE, 20), moved(SQUARE[:7], 30), moved(SQUARE, 40)])
    assert cli.main(["mesh", path, "-o", "o.msh", "--split"]) == 2
    assert not list(Path().glob("*.msh"))
    capsys.readouterr()
    assert cli.main(["mesh", path, "-o", "o.msh", "--split", "--keep-going"]) == 1
    out, err = capsys.readouterr()
    assert sorted(each.name for each in Path().glob("*.msh")) == ["o-0.msh", "o-2.msh", "o-4.msh"]
    assert [line.split(":")[0] for line in out.splitlines()] == ["part[0]", "part[2]", "part[4]"]
    first, second, last = err.splitlines()
    assert first.startswith("left out: part.wkt: polygon 1: outer ring crosses itself")
    assert second.startswith("left out: part.wkt: polygon 3: ")
    assert last == "part.wkt: 2 polygons left out: 1, 3"


def test_one_mesh_of_those_that_are_sound(capsys: pytest.CaptureFixture[str]) -> None:
    """Neighbours stay joined; of two that overlap the later one goes."""
    path = file_of([SQUARE, moved(SQUARE, 2), moved(SQUARE, 1), moved(BOW, 9)])
    assert cli.main(["mesh", path, "-o", "o.msh", "--keep-going"]) == 1
    out, err = capsys.readouterr()
    assert Path("o.msh").exists()
    assert out.count("quads in") == 1
    assert "polygon 2: overlaps polygon 0 at" in err
    assert err.splitlines()[-1] == "part.wkt: 2 polygons left out: 3, 2"


def test_the_lines_of_what_is_left_out_go_too(capsys: pytest.CaptureFixture[str]) -> None:
    path = file_of([SQUARE, moved(BOW, 10)], ", LINESTRING(10.1 1.5, 10.2 1), LINESTRING(0.5 1, 1.5 1)")
    assert cli.main(["mesh", path, "-o", "o.msh", "--keep-going", "--edge-length", "0.5"]) == 1
    assert capsys.readouterr().err.splitlines()[-1] == "part.wkt: 1 polygon left out: 1; 1 line or point left out"


def test_periodic_sides_leave_nothing_out_that_is_sound(capsys: pytest.CaptureFixture[str]) -> None:
    path = file_of([SQUARE, moved(BOW, 10)])
    asked = ["--keep-going", "--edge-length", "0.5", "--periodic", "left", "right"]
    assert cli.main(["mesh", path, "-o", "o.msh", *asked]) == 1
    assert capsys.readouterr().err.splitlines()[-1] == "part.wkt: 1 polygon left out: 1"
    assert Path("o.msh").exists()


def test_no_region_is_meshed_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """However many fail."""
    tried: list[str] = []
    mesh_domain = polygon_to_mesh.mesh_domain

    def some(policy: Policy, domain: Domain, **options: Any) -> MeshResult:
        tried.append(domain.name)
        if len(tried) % 2:
            raise MeshingError(f"{domain.name}: too thin")
        return mesh_domain(policy, domain, **options)

    monkeypatch.setattr(polygon_to_mesh, "mesh_domain", some)
    path = file_of([moved(SQUARE, 10 * i) for i in range(6)])
    assert cli.main(["mesh", path, "-o", "o.msh", "--keep-going"]) == 1
    assert tried == [f"part[{i}]" for i in range(6)]


def test_nothing_is_left_out_of_what_is_sound(capsys: pytest.CaptureFixture[str]) -> None:
    path = file_of([SQUARE, moved(SQUARE, 2)])
    assert cli.main(["mesh", path, "-o", "o.msh", "--keep-going"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("rings", [[BOW], [BOW, moved(BOW, 9)]])
def test_where_nothing_is_sound_it_is_refused(
    rings: list[list[tuple[float, float]]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["mesh", file_of(rings), "-o", "o.msh", "--keep-going"]) == 2
    assert "crosses itself" in capsys.readouterr().err.splitlines()[-1]
    assert not Path("o.msh").exists()


@pytest.mark.parametrize("split", [[], ["--split"]])
def test_a_polygon_that_has_no_mesh_is_left_out(
    split: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = polygon_to_mesh.mesh_domain

    def refuse(policy: object, domain: PlainMesh, **options: object) -> MeshResult:
        if domain.name == "part[1]":
            raise MeshingError(f"{domain.name}: too thin")
        return before(policy, domain, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(polygon_to_mesh, "mesh_domain", refuse)
    path = file_of([SQUARE, moved(SQUARE, 2), moved(SQUARE, 9)])
    assert cli.main(["mesh", path, "-o", "o.msh", "--keep-going", *split]) == 1
    assert sorted(each.name for each in Path().glob("*.msh")) == (["o-0.msh", "o-2.msh"] if split else ["o.msh"])
    assert capsys.readouterr().err.splitlines() == ["left out: part[1]: too thin", "part.wkt: 1 polygon left out: 1"]
