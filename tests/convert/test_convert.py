"""Meshes as objects of other libraries: the same vertices and elements, and all names."""

from __future__ import annotations

import base64
import re
import sys
from pathlib import Path

import meshio
import numpy as np
import pytest

import freemesh_ray
from envs.errors import UserError
from envs.polygons.drawing import Drawing, Line, Place
from freemesh_ray.convert import to_pyvista

LEFT = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


@pytest.fixture(scope="module")
def two() -> freemesh_ray.Mesh:
    """Two materials side by side, with a named wall, a named interface and a named point."""
    drawing = Drawing(
        [[LEFT], [LEFT + np.array([1.0, 0.0])]],
        lines=[Line(LEFT[[3, 0]], "wall"), Line(LEFT[1:3], "between")],
        places=[Place(0.5, 0.5, "sensor")],
        regions=["steel", "copper"],
    )
    return freemesh_ray.mesh(drawing, edge_length=0.125)


def test_meshio_has_every_name(two: freemesh_ray.Mesh, tmp_path: Path) -> None:
    made = two.to_meshio()
    np.testing.assert_array_equal(made.points, two.vertices)
    np.testing.assert_array_equal(made.cells_dict["quad"], two.quads)
    sets = made.cell_sets_dict
    assert set(sets) == {"steel", "copper", "between", "sensor", *two.groups.sides}
    np.testing.assert_array_equal(made.cells_dict["line"][sets["wall"]["line"]], two.groups.sides["wall"])
    np.testing.assert_array_equal(sets["steel"]["quad"], two.groups.regions["steel"])
    assert made.cells_dict["vertex"][sets["sensor"]["vertex"]].item() == two.groups.points["sensor"]
    made.write(tmp_path / "two.vtu")
    assert len(meshio.read(tmp_path / "two.vtu").cells_dict["quad"]) == len(two.quads)


def test_scikit_fem_solves_between_named_sides(two: freemesh_ray.Mesh) -> None:
    """Heat through two materials in a row: the temperature where they meet is known."""
    skfem = pytest.importorskip("skfem")
    from skfem.helpers import dot, grad

    mesh = two.to_skfem()
    np.testing.assert_array_equal(mesh.p.T, two.vertices)
    assert set(mesh.subdomains) == {"steel", "copper"}
    element = skfem.ElementQuad1()
    conduction = skfem.BilinearForm(lambda u, v, w: dot(grad(u), grad(v)))
    conductivity = {"steel": 1.0, "copper": 8.0}
    matrix = sum(k * conduction.assemble(skfem.Basis(mesh, element, elements=name)) for name, k in conductivity.items())
    basis = skfem.Basis(mesh, element)
    hot, cold = basis.get_dofs("wall"), basis.get_dofs(lambda x: x[0] == 2.0)
    fixed = np.zeros(basis.N)
    fixed[hot.all()] = 9.0
    solved = skfem.solve(*skfem.condense(matrix, np.zeros(basis.N), x=fixed, D=np.concatenate([hot.all(), cold.all()])))
    between = basis.get_dofs("between").all()
    np.testing.assert_allclose(solved[between], 1.0, rtol=1e-9)


def test_pyvista_has_every_name(two: freemesh_ray.Mesh) -> None:
    pytest.importorskip("pyvista")
    blocks = two.to_pyvista()
    assert set(blocks.keys()) == {"elements", "between", *two.groups.sides}
    elements = blocks["elements"]
    assert elements.n_cells == len(two.quads)
    assert elements.compute_cell_sizes()["Area"].sum() == pytest.approx(2.0)
    assert sorted(np.unique(elements["region"])) == [1, 2]
    assert blocks["wall"].n_lines == 8


def test_a_library_that_is_missing_is_one_line(two: freemesh_ray.Mesh, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(UserError, match="PyVista is not installed; install it: pip install pyvista"):
        to_pyvista(two)


def test_a_notebook_shows_the_picture_and_the_figures(two: freemesh_ray.Mesh) -> None:
    html = two._repr_html_()
    png = re.search(r'src="data:image/png;base64,([^"]+)"', html)
    assert png is not None
    assert base64.b64decode(png[1])[:8] == b"\x89PNG\r\n\x1a\n"
    assert f"{len(two.quads)} quads" in html
    assert "<Mesh" not in html  # the text is escaped
