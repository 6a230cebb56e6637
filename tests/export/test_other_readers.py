"""Programs and libraries that read the formats: the same area, the same parts, by their names where they keep them."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from shapes import block, named

from freemesh_ray.export import FORMATS, write
from freemesh_ray.export.element_kinds import quadrilateral
from freemesh_ray.export.names import renamed
from freemesh_ray.export.plane import plane_elements
from freemesh_ray.export.solid import solid_elements

#: What checkMesh asks of a case beside its mesh.
CONTROL = "application none; startFrom startTime; startTime 0; stopAt endTime; endTime 1; deltaT 1; writeInterval 1;"
SCHEMES = "ddtSchemes{} gradSchemes{} divSchemes{} laplacianSchemes{} interpolationSchemes{} snGradSchemes{}"


# ---- VTK -------------------------------------------------------------------------------------------------------------


def vtk_areas(grid: object, kinds: set[int]) -> float:
    """The area of a grid's cells of some kinds, by an integral over what VTK makes of their shape."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    total = 0.0
    points = vtk_to_numpy(grid.GetPoints().GetData())
    for i in range(grid.GetNumberOfCells()):
        cell = grid.GetCell(i)
        if cell.GetCellType() not in kinds:
            continue
        ids = [cell.GetPointId(k) for k in range(cell.GetNumberOfPoints())]
        x, w = np.polynomial.legendre.leggauss(5)
        weights, derivatives = [0.0] * len(ids), [0.0] * (2 * len(ids))
        for a, wa in zip(x, w, strict=True):
            for b, wb in zip(x, w, strict=True):
                cell.InterpolateFunctions([(a + 1) / 2, (b + 1) / 2, 0.0], weights)
                cell.InterpolateDerivs([(a + 1) / 2, (b + 1) / 2, 0.0], derivatives)
                # Lagrange's cells have the two derivatives of a node side by side, others all of a direction.
                table = (
                    np.reshape(derivatives, (-1, 2)).T if cell.GetCellType() == 70 else np.reshape(derivatives, (2, -1))
                )
                jacobian = table @ points[ids, :2]
                determinant = np.linalg.det(jacobian)
                assert determinant > 0.0
                total += wa * wb / 4 * determinant
    return total


@pytest.mark.parametrize("nodes", FORMATS[".vtu"].nodes)
def test_vtk_finds_the_area_and_the_names_of_a_vtu(tmp_path: Path, nodes: int):
    vtk = pytest.importorskip("vtk")
    mesh = named()
    write(mesh, tmp_path / "mesh.vtu", **({"quadratic": True} if nodes == 8 else {"order": quadrilateral(nodes).order}))
    reader = vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(tmp_path / "mesh.vtu"))
    reader.Update()
    grid, expected = reader.GetOutput(), plane_elements(mesh, nodes)
    assert vtk_areas(grid, {9, 23, 28, 70}) == pytest.approx(mesh.areas.sum(), rel=1e-12)
    fields = grid.GetFieldData()
    names = {fields.GetArrayName(i): int(fields.GetArray(i).GetTuple(0)[0]) for i in range(fields.GetNumberOfArrays())}
    assert names == {group.name: group.number for group in expected.groups()}
    group = grid.GetCellData().GetArray("group")
    for part in expected.facets:
        mine = [i for i in range(grid.GetNumberOfCells()) if group.GetTuple(i)[0] == names[part.name]]
        ids = [[grid.GetCell(i).GetPointId(k) for k in range(grid.GetCell(i).GetNumberOfPoints())] for i in mine]
        assert ids == part.facets.tolist()


@pytest.mark.parametrize("order", [1, 2])
def test_vtk_reads_exodus(tmp_path: Path, order: int):
    vtk = pytest.importorskip("vtk")
    write(named(), tmp_path / "mesh.e", order=order)
    reader = vtk.vtkExodusIIReader()
    reader.SetFileName(str(tmp_path / "mesh.e"))
    reader.UpdateInformation()
    names = {}
    for what in (reader.ELEM_BLOCK, reader.SIDE_SET, reader.NODE_SET):
        count = reader.GetNumberOfObjects(what)
        names[what] = [reader.GetObjectName(what, i) for i in range(count)]
        for i in range(count):
            reader.SetObjectStatus(what, i, 1)
    reader.Update()
    expected, _ = renamed(plane_elements(named(), 4 if order == 1 else 9), FORMATS[".e"].rule)
    assert names[reader.ELEM_BLOCK] == ["steel", "copper"]
    assert names[reader.SIDE_SET] == [part.name for part in expected.facets]
    assert names[reader.NODE_SET] == ["gauge"]
    found, iterator = {}, reader.GetOutput().NewIterator()
    while not iterator.IsDoneWithTraversal():
        data = iterator.GetCurrentDataObject()
        found[iterator.GetCurrentMetaData().Get(vtk.vtkCompositeDataSet.NAME())] = data
        iterator.GoToNextItem()
    blocks = [data for name, data in found.items() if any(region in name for region in ("steel", "copper"))]
    # VTK keeps no more of an Exodus file's places than single precision.
    assert sum(vtk_areas(data, {9, 28}) for data in blocks) == pytest.approx(named().areas.sum(), rel=1e-6)
    for part in expected.facets:
        (side,) = (data for name, data in found.items() if name == part.name or name.startswith(f"{part.name} "))
        assert side.GetNumberOfCells() == len(part.facets)
        places = {tuple(side.GetPoint(i)[:2]) for i in range(side.GetNumberOfPoints())}
        assert places == {tuple(p) for p in expected.nodes[np.unique(part.facets)].astype(np.float32).tolist()}


@pytest.mark.parametrize("order", [1, 2])
def test_vtk_reads_xdmf(tmp_path: Path, order: int):
    vtk = pytest.importorskip("vtk")
    write(named(), tmp_path / "mesh.xdmf", order=order)
    reader = vtk.vtkXdmfReader()
    reader.SetFileName(str(tmp_path / "mesh.xdmf"))
    reader.Update()
    cells, facets = (reader.GetOutputDataObject(0).GetBlock(i) for i in range(2))
    assert vtk_areas(cells, {9, 28}) == pytest.approx(named().areas.sum(), rel=1e-12)
    assert facets.GetNumberOfCells() == sum(len(part.facets) for part in plane_elements(named()).facets)


@pytest.mark.parametrize("suffix", [".vtu", ".e", ".xdmf"])
@pytest.mark.parametrize("nodes", [8, 20])
def test_vtk_finds_the_volume_of_hexahedra(tmp_path: Path, suffix: str, nodes: int):
    vtk = pytest.importorskip("vtk")
    mesh = block(nodes)
    write(mesh, tmp_path / f"mesh{suffix}")
    if suffix == ".vtu":
        reader = vtk.vtkXMLUnstructuredGridReader()
    else:
        reader = vtk.vtkExodusIIReader() if suffix == ".e" else vtk.vtkXdmfReader()
    reader.SetFileName(str(tmp_path / f"mesh{suffix}"))
    reader.Update()
    grids = [reader.GetOutputDataObject(0)]
    if suffix != ".vtu":
        iterator, grids = grids[0].NewIterator(), []
        while not iterator.IsDoneWithTraversal():
            grids.append(iterator.GetCurrentDataObject())
            iterator.GoToNextItem()
    total = 0.0
    for grid in grids:
        for i in range(grid.GetNumberOfCells()):
            cell = grid.GetCell(i)
            if cell.GetCellDimension() == 3:
                assert cell.GetNumberOfPoints() == nodes
                # Where the middle of an edge is out of its place, this is another node's.
                corners = [np.array(cell.GetPoints().GetPoint(k)) for k in range(nodes)]
                for e in range(cell.GetNumberOfEdges()) if nodes == 20 else ():
                    a, b, c = (np.array(cell.GetEdge(e).GetPoints().GetPoint(k)) for k in range(3))
                    np.testing.assert_allclose(c, (a + b) / 2, atol=1e-6)
                p = np.array(corners[:8])
                total += abs(np.linalg.det([p[1] - p[0], p[3] - p[0], p[4] - p[0]])) / 2
                total += abs(np.linalg.det([p[1] - p[2], p[3] - p[2], p[4] - p[0]])) / 2
    assert total == pytest.approx(named().areas.sum() * 1.4, rel=1e-6)


# ---- Gmsh ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("version", ["4.1", "2.2"])
@pytest.mark.parametrize("nodes", FORMATS[".msh"].nodes)
def test_gmsh_finds_the_area_and_each_curve_in_one_group(tmp_path: Path, version: str, nodes: int):
    gmsh = pytest.importorskip("gmsh")
    mesh, expected = named(), plane_elements(named(), nodes)
    options = {"quadratic": True} if nodes == 8 else {"order": expected.kind.order}
    write(mesh, tmp_path / "mesh.msh", version=version, **options)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.logger.start()
        gmsh.open(str(tmp_path / "mesh.msh"))
        assert not [line for line in gmsh.logger.get() if not line.startswith("Info")]
        (kind,) = gmsh.model.mesh.getElementTypes(2)
        _, _, order, count, *_ = gmsh.model.mesh.getElementProperties(kind)
        assert (order, count) == (expected.kind.order, nodes)
        points, weights = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss8")
        _, determinants, _ = gmsh.model.mesh.getJacobians(kind, points)
        groups = {gmsh.model.getPhysicalName(*pair): pair for pair in gmsh.model.getPhysicalGroups()}
        members = {
            name: set((gmsh.model.mesh.getNodesForPhysicalGroup(*pair)[0] - 1).tolist())
            for name, pair in groups.items()
        }
        used = [entity for pair in groups.values() for entity in gmsh.model.getEntitiesForPhysicalGroup(*pair).tolist()]
        assert len(gmsh.model.getEntities(1)) == len(expected.facets)
        assert all(len(gmsh.model.getPhysicalGroupsForEntity(1, tag)) == 1 for _, tag in gmsh.model.getEntities(1))
    finally:
        gmsh.logger.stop()
        gmsh.finalize()
    determinants = determinants.reshape(-1, len(weights))
    assert (determinants > 0.0).all()
    assert (determinants @ weights).sum() == pytest.approx(mesh.areas.sum(), rel=1e-12)
    assert len(used) == len(groups)
    assert sorted(groups) == sorted(group.name for group in expected.groups())
    for name, nodes_of in expected.node_sets:
        assert members[name] == set(nodes_of.tolist())


@pytest.mark.parametrize("nodes", [8, 20])
@pytest.mark.parametrize("suffix", [".msh", ".unv"])
def test_gmsh_finds_the_volume_of_hexahedra(tmp_path: Path, suffix: str, nodes: int):
    gmsh = pytest.importorskip("gmsh")
    write(block(nodes), tmp_path / f"mesh{suffix}")
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tmp_path / f"mesh{suffix}"))
        (kind,) = gmsh.model.mesh.getElementTypes(3)
        points, weights = gmsh.model.mesh.getIntegrationPoints(kind, "Gauss4")
        _, determinants, _ = gmsh.model.mesh.getJacobians(kind, points)
        faces = gmsh.model.mesh.getElementTypes(2)
    finally:
        gmsh.finalize()
    determinants = determinants.reshape(-1, len(weights))
    assert (determinants > 0.0).all()
    assert (determinants @ weights).sum() == pytest.approx(named().areas.sum() * 1.4, rel=1e-9)
    assert len(faces) == 1


@pytest.mark.parametrize("quadratic", [False, True])
def test_gmsh_reads_unv(tmp_path: Path, quadratic: bool):
    gmsh = pytest.importorskip("gmsh")
    write(named(), tmp_path / "mesh.unv", quadratic=quadratic)
    expected = plane_elements(named(), 8 if quadratic else 4)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.logger.start()
        gmsh.open(str(tmp_path / "mesh.unv"))
        assert not [line for line in gmsh.logger.get() if not line.startswith("Info")]
        tags, nodes = gmsh.model.mesh.getElementsByType(16 if quadratic else 3)
        lines, ends = gmsh.model.mesh.getElementsByType(8 if quadratic else 1)
    finally:
        gmsh.logger.stop()
        gmsh.finalize()
    found = dict(zip(tags.tolist(), nodes.reshape(len(tags), -1).tolist(), strict=True))
    assert [found[i] for i in sorted(found)] == (expected.elements + 1).tolist()
    rows = dict(zip(lines.tolist(), ends.reshape(len(lines), -1).tolist(), strict=True))
    assert [rows[i] for i in sorted(rows)] == np.concatenate([part.facets + 1 for part in expected.facets]).tolist()


# ---- Nastran, MFEM, OpenFOAM, scikit-fem -----------------------------------------------------------------------------


@pytest.mark.parametrize("quadratic", [False, True])
def test_pynastran_reads_sets_constraints_and_properties(
    tmp_path: Path, quadratic: bool, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(np, "in1d", np.isin, raising=False)  # which its newest release still asks for
    bdf = pytest.importorskip("pyNastran.bdf.bdf")
    write(named(), tmp_path / "mesh.bdf", quadratic=quadratic)
    model = bdf.BDF(debug=None)
    model.read_bdf(str(tmp_path / "mesh.bdf"))
    expected = plane_elements(named(), 8 if quadratic else 4)
    assert {e.type for e in model.elements.values()} == {"CQUAD8" if quadratic else "CQUAD4"}
    assert [model.elements[i].node_ids for i in sorted(model.elements)] == (expected.elements + 1).tolist()
    assert [model.elements[i].Pid() - 1 for i in sorted(model.elements)] == expected.region_of.tolist()
    assert [(model.properties[i].type, model.properties[i].Mid()) for i in (1, 2)] == [("PSHELL", 1), ("PSHELL", 2)]
    wanted = [("boundary", expected.boundary.nodes), *expected.node_sets]
    for i, (_, nodes) in enumerate(wanted, 1):
        assert sorted(model.sets[i].ids) == (nodes + 1).tolist()
        (constraint,) = model.spcs[i]
        assert (sorted(constraint.node_ids), constraint.components) == ((nodes + 1).tolist(), "123456")


@pytest.mark.parametrize("nodes", [8, 20])
def test_pynastran_finds_the_volume_of_hexahedra(tmp_path: Path, nodes: int, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(np, "in1d", np.isin, raising=False)
    bdf = pytest.importorskip("pyNastran.bdf.bdf")
    write(block(nodes), tmp_path / "mesh.bdf")
    model = bdf.BDF(debug=None)
    model.read_bdf(str(tmp_path / "mesh.bdf"))
    assert sum(e.Volume() for e in model.elements.values()) == pytest.approx(named().areas.sum() * 1.4, rel=1e-9)
    expected = solid_elements(block(nodes))
    places = {i: node.get_position() for i, node in model.nodes.items()}
    for element in model.elements.values() if nodes == 20 else ():
        ids = element.node_ids
        # Middles 9 to 12 below, 13 to 16 between, 17 to 20 above.
        ends = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 5), (2, 6), (3, 7), (4, 5), (5, 6), (6, 7), (7, 4)]
        for middle, (a, b) in zip(ids[8:], ends, strict=True):
            np.testing.assert_allclose(places[middle], (places[ids[a]] + places[ids[b]]) / 2, atol=1e-9)
    assert len(model.elements) == len(expected.elements)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_mfem_finds_the_area_and_attributes(tmp_path: Path, order: int):
    mfem = pytest.importorskip("mfem.ser")
    mesh = named()
    write(mesh, tmp_path / "mesh.mesh", order=order)
    found = mfem.Mesh(str(tmp_path / "mesh.mesh"), 1, 0)
    expected = plane_elements(mesh, {1: 4, 2: 9, 3: 16, 4: 25}[order])
    assert (found.Dimension(), found.GetNE(), found.GetNBE()) == (2, len(mesh.quads), len(mesh.segments))
    assert found.CheckElementOrientation(False) == found.CheckBdrElementOrientation(False) == 0
    areas = [found.GetElementVolume(i) for i in range(found.GetNE())]
    np.testing.assert_allclose(areas, mesh.areas, rtol=1e-9)
    assert [found.GetAttribute(i) - 1 for i in range(found.GetNE())] == expected.region_of.tolist()
    attributes = np.repeat(np.arange(1, len(expected.sides) + 1), [len(side.facets) for side in expected.sides])
    assert [found.GetBdrAttribute(i) for i in range(found.GetNBE())] == attributes.tolist()


@pytest.mark.skipif(shutil.which("checkMesh") is None, reason="OpenFOAM is not installed")
@pytest.mark.parametrize("solid", [False, True], ids=["plane", "solid"])
def test_check_mesh_of_openfoam_passes(tmp_path: Path, solid: bool):
    write(block() if solid else named(), tmp_path / "case.foam")
    (tmp_path / "system").mkdir()
    for name, text in (("controlDict", CONTROL), ("fvSchemes", SCHEMES), ("fvSolution", "")):
        head = f"FoamFile {{ version 2.0; format ascii; class dictionary; object {name}; }}\n"
        (tmp_path / "system" / name).write_text(head + text)
    # Debian's package keeps what the programs ask for here, and does not say so to them.
    environment = {"WM_PROJECT_DIR": "/usr/share/openfoam"} | dict(os.environ)
    done = subprocess.run(["checkMesh"], cwd=tmp_path, capture_output=True, text=True, env=environment, timeout=300)
    assert "Mesh OK." in done.stdout, done.stdout[-3000:] + done.stderr[-1000:]
    assert "left_side" in done.stdout
    assert "cell zones:       2" in done.stdout
    assert "face zones:       1" in done.stdout
    assert "point zones:      1" in done.stdout
    assert ("Mesh has 2 geometric (non-empty/wedge) directions (1 1 0)" in done.stdout) != solid


@pytest.mark.parametrize("order", [1, 2])
def test_scikit_fem_solves_on_a_gmsh_file(tmp_path: Path, order: int):
    skfem = pytest.importorskip("skfem")
    mesh = named()
    write(mesh, tmp_path / "mesh.msh", order=order)
    found = skfem.Mesh.load(str(tmp_path / "mesh.msh"))
    element = skfem.ElementQuad2() if order == 2 else skfem.ElementQuad1()
    basis = skfem.Basis(found, element)
    assert skfem.Functional(lambda w: 1.0 + 0 * w.x[0]).assemble(basis) == pytest.approx(mesh.areas.sum(), rel=1e-9)
    assert {"steel", "copper"} <= set(found.subdomains)
    # Of elements with nine nodes it looks for sides with two, which Gmsh's own files have not either.
    for side in plane_elements(mesh).sides if order == 1 else ():
        length = np.linalg.norm(np.diff(mesh.vertices[side.facets], axis=1), axis=-1).sum()
        along = skfem.FacetBasis(found, element, facets=found.boundaries[side.name])
        assert skfem.Functional(lambda w: 1.0 + 0 * w.x[0]).assemble(along) == pytest.approx(length, rel=1e-9)
