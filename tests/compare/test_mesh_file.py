"""Mesh files as peers: what was written comes back with the same figures, and belongs to the domain that it is of."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest

from envs.domains.load import from_rings
from envs.mesh import Mesh
from envs.types import Domain
from freemesh_ray import export
from freemesh_ray.compare.foreign_mesh import MeshFileError, files, placed, read
from freemesh_ray.compare.mixed_mesh import PeerError, of_mesh
from freemesh_ray.compare.row import figures
from freemesh_ray.mesh_geometry.metrics import measure


def grid(n: int, name: str = "grid") -> tuple[Domain, Mesh]:
    """An n by n square of squares, the inner vertices shaken, and its domain."""
    sides = [
        [(i, 0) for i in range(n)],
        [(n, i) for i in range(n)],
        [(n - i, n) for i in range(n)],
        [(0, n - i) for i in range(n)],
    ]
    ring = [point for side in sides for point in side]
    inner = [(x, y) for y in range(1, n) for x in range(1, n)]
    number = {point: i for i, point in enumerate([*ring, *inner])}
    quads = [[number[p] for p in ((x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1))] for x in range(n) for y in range(n)]
    vertices = np.array([*ring, *inner], dtype=float)
    vertices[len(ring) :] += np.random.default_rng(n).uniform(-0.2, 0.2, (len(inner), 2))
    domain = from_rings(ring, name=name)
    return domain, Mesh(name, vertices, np.array(quads), domain.segments, True)


@pytest.mark.parametrize("suffix", [".inp", ".msh", ".vtu"])
@pytest.mark.parametrize("n", [2, 5])
def test_what_was_exported_comes_back_with_the_same_figures(tmp_path: Path, suffix: str, n: int) -> None:
    domain, mesh = grid(n)
    path = tmp_path / f"mesh{suffix}"
    export.write(mesh, path)
    found = placed(f"pave={path}", [domain])
    assert found.domain == "grid"
    assert found.mesh.mesher == "pave"
    assert found.mesh.keeps(domain)
    expected = figures(of_mesh(mesh, "x", float("nan")), domain)
    assert figures(found.mesh, domain) == pytest.approx(expected, rel=1e-14, nan_ok=True)


def test_other_programs_decks_are_read(tmp_path: Path) -> None:
    (tmp_path / "d.inp").write_text(
        "*Heading\n** a comment\n*Node\n 7, 0., 0.\n 8, 1, 0, 0\n 9, 1, 1, 0\n 10, 0, 1, 0\n 11, 2., 0., 0.\n"
        "*Element, type=S4R, elset=a\n 1, 7, 8,\n 9, 10\n*ELEMENT, TYPE=STRI3\n2, 8, 11, 9\n"
        "*Element, type=B21\n3, 7, 8\n*Element, type=C3D4\n4, 7, 8, 9, 10\n*Nset, nset=all\n7, 8, 9\n"
    )
    mesh = read(tmp_path / "d.inp")
    assert (len(mesh.quads), len(mesh.triangles)) == (1, 1)
    assert measure(mesh)["eta"] == pytest.approx(1.0)


def test_quadratic_elements_and_triangles_are_read(tmp_path: Path) -> None:
    points = np.array([[0, 0, 7], [1, 0, 7], [1, 1, 7], [0, 1, 7], [2, 0, 7]] + [[0.5, 0.5, 7]] * 4, dtype=float)
    cells = [("quad8", np.array([[3, 2, 1, 0, 5, 6, 7, 8]])), ("triangle", np.array([[1, 4, 2]])), ("line", [[0, 1]])]
    meshio.Mesh(points, cells).write(tmp_path / "m.vtu")
    mesh = read(tmp_path / "m.vtu")
    assert mesh.vertices.shape == (5, 2)
    assert (len(mesh.quads), len(mesh.triangles)) == (1, 1)
    assert measure(mesh)["eta"] == pytest.approx(1.0)


def test_a_mesh_goes_to_the_domain_whose_boundary_it_keeps(tmp_path: Path) -> None:
    domain, mesh = grid(3, "fine")
    coarse = from_rings([[0, 0], [3, 0], [3, 3], [0, 3]], name="coarse")
    export.write(mesh, tmp_path / "m.inp")
    assert placed(f"a={tmp_path / 'm.inp'}", [coarse, domain]).domain == "fine"
    assert placed(f"a={tmp_path / 'm.inp'}", [coarse]).domain == "coarse", "by its extent"
    for name in ("part-7", "random-7_holes=1"):
        assert placed(f"{name}:a={tmp_path / 'm.inp'}", [replace(coarse, name=name), domain]).domain == name


def test_a_label_gathers_files_and_fails_where_it_has_none(tmp_path: Path) -> None:
    (first, mesh), (second, other) = grid(2, "two"), grid(3, "three")
    export.write(mesh, tmp_path / "2.inp")
    export.write(other, tmp_path / "3.inp")
    (mesher,) = files([f"pave={tmp_path / '3.inp'}", f"pave={tmp_path / '2.inp'}"], [first, second])
    assert mesher.name == "pave"
    assert len(mesher.run(first)[0].quads) == 4
    assert len(mesher.run(second)[0].quads) == 9
    with pytest.raises(PeerError, match="no file given for four"):
        mesher.run(replace(first, name="four"))


@pytest.mark.parametrize(("text", "message"), [
    ("m.inp", "write LABEL=FILE"),
    ("=m.inp", "write LABEL=FILE"),
    ("a=none.inp", "no such mesh file"),
    ("elsewhere:a=m.inp", "elsewhere is not among the domains"),
    ("a=bad.inp", "line 2: 1, x, y is no node"),
    ("a=bad.xyz", r"unknown format .\.xyz.; use one of .inp, .msh"),
    ("a=bad.vtu", "bad.vtu: cannot be read"),
    ("a=far.vtu", "has the extent of no domain here; write DOMAIN:a=far.vtu"),
    ("a=lines.vtu", "holds no quadrilaterals"),
    ("a=bent.vtu", "not in one plane"),
])  # fmt: skip
def test_bad_files_are_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, message: str) -> None:
    monkeypatch.chdir(tmp_path)
    domain, mesh = grid(2)
    export.write(mesh, "m.inp")
    Path("bad.inp").write_text("*NODE\n1, x, y\n")
    for bad in ("bad.xyz", "bad.vtu"):
        Path(bad).write_text("nonsense")
    export.write(replace(mesh, vertices=mesh.vertices + 10.0), "far.vtu")
    flat = np.column_stack([mesh.vertices, np.zeros(len(mesh.vertices))])
    meshio.Mesh(flat, [("line", [[0, 1]])]).write("lines.vtu")
    meshio.Mesh(flat + mesh.vertices[:, :1] * [0, 0, 1], [("quad", mesh.quads)]).write("bent.vtu")
    with pytest.raises(MeshFileError, match=message) as caught:
        placed(text, [domain])
    assert "\n" not in str(caught.value)


def test_two_files_of_one_label_for_one_domain_are_refused(tmp_path: Path) -> None:
    domain, mesh = grid(2)
    export.write(mesh, tmp_path / "m.inp")
    with pytest.raises(MeshFileError, match="two files for grid"):
        files([f"a={tmp_path / 'm.inp'}"] * 2, [domain])
