"""The Python entrance: polygons of every kind in, a finished mesh out."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely
from checkout import ROOT

import freemesh_ray
from envs.domains.load import load
from envs.mdp.observation import observation_size
from envs.types import DomainError, MeshingParameters
from freemesh_ray.mesher import polygon_to_mesh
from freemesh_ray.policies.policy import SHIPPED, Policy, PolicyError
from freemesh_ray.storage.atomic import OutputError

OUTLINE = np.array([[0, 0], [4, 0], [4, 1.5], [1.5, 1.5], [1.5, 3], [0, 3]], dtype=np.float64)


@pytest.fixture(scope="module")
def mesh() -> freemesh_ray.Mesh:
    return freemesh_ray.mesh(shapely.Polygon(OUTLINE), edge_length=0.25)


def test_a_shapely_polygon_becomes_a_mesh(mesh: freemesh_ray.Mesh) -> None:
    polygon = shapely.Polygon(OUTLINE)
    assert mesh.defects(area=polygon.area) == []
    assert mesh.vertices.shape[1] == 2
    assert mesh.quads.shape[1] == 4
    given = mesh.vertices[np.unique(mesh.segments)]
    assert shapely.distance(polygon.boundary, shapely.points(given)).max() < 1e-12
    for corner in OUTLINE:
        assert (given == corner).all(axis=1).any()


def test_ring_vertices_are_the_boundary_vertices() -> None:
    ring = shapely.segmentize(shapely.Polygon(OUTLINE), 0.3).exterior
    made = freemesh_ray.mesh(shapely.Polygon(ring), fix_parity=True)
    given = {tuple(point) for point in made.vertices[np.unique(made.segments)]}
    assert {tuple(point) for point in np.asarray(ring.coords)} <= given


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_units_and_scale_are_kept(scale: float) -> None:
    made = freemesh_ray.mesh(scale * OUTLINE, edge_length=0.25 * scale)
    assert made.defects(area=scale**2 * shapely.Polygon(OUTLINE).area) == []
    assert np.ptp(made.vertices, axis=0) == pytest.approx(scale * np.ptp(OUTLINE, axis=0))


@pytest.mark.slow
def test_a_size_that_is_said_inside_is_kept_to(tmp_path: Path) -> None:
    """Small elements around a point, said in four ways; sizes grow from there to the boundary."""
    parameters = MeshingParameters(scale="size", density="local")
    layer = np.zeros((observation_size(parameters), 6), dtype=np.float32), np.array([0, 0, 0, -9, -9, -9], np.float32)
    options = {"edge_length": 0.25, "policy": Policy([layer], parameters)}
    plain = freemesh_ray.mesh(OUTLINE, **options)
    row = freemesh_ray.mesh(OUTLINE, size=np.array([[0.75, 0.75, 0.05]]), **options)
    said = freemesh_ray.mesh(OUTLINE, size=lambda at: 0.05 + 0.2 * np.hypot(*(at - 0.75).T), **options)
    text = freemesh_ray.mesh(OUTLINE, size="0.05 + 0.2 * hypot(x - 0.75, y - 0.75)", **options)
    (tmp_path / "point.csv").write_text("x,y,size\n0.75,0.75,0.05\n")
    file = freemesh_ray.mesh(OUTLINE, size=tmp_path / "point.csv", **options)
    np.testing.assert_array_equal(text.vertices, said.vertices)
    np.testing.assert_array_equal(file.vertices, row.vertices)
    for made in (row, said):
        assert made.defects(area=shapely.Polygon(OUTLINE).area) == []
        assert len(made.segments) >= len(plain.segments)
        middles = made.vertices[made.quads].mean(axis=1)
        near = np.hypot(*(middles - 0.75).T) < 0.3
        assert near.sum() > 2 * (np.hypot(*(plain.vertices[plain.quads].mean(axis=1) - 0.75).T) < 0.3).sum()
        assert made.areas[near].mean() < 0.5 * made.areas[~near].mean()
    with pytest.raises(PolicyError, match=r"env\.scale = front"):
        freemesh_ray.mesh(OUTLINE, edge_length=0.25, density="medium", size=lambda at: 0.1)


def test_a_file_is_a_polygon_too() -> None:
    file = ROOT / "docs" / "examples" / "part.geojson"
    mesh = freemesh_ray.mesh(file)
    assert (mesh.name, freemesh_ray.mesh(str(file), name="plate").name) == ("part", "plate")
    assert len(mesh.segments) == len(load(str(file)).segments)
    with pytest.raises(DomainError, match=r"nowhere\.geojson"):
        freemesh_ray.mesh("nowhere.geojson")


def test_a_mesh_is_shown_in_one_line(mesh: freemesh_ray.Mesh) -> None:
    assert repr(mesh) == f"<Mesh polygon: {len(mesh.quads)} quads, {len(mesh.vertices)} vertices>"
    assert "\n" not in repr(mesh.result.raw)


def test_holes_are_kept() -> None:
    polygon = shapely.Polygon(OUTLINE).difference(shapely.Point(0.75, 0.75).buffer(0.35))
    made = freemesh_ray.mesh(polygon, edge_length=0.2)
    assert made.defects() == []
    assert made.areas.sum() == pytest.approx(polygon.area, rel=0.01)


def test_the_finished_mesh_is_no_poorer_than_the_raw(mesh: freemesh_ray.Mesh) -> None:
    raw = freemesh_ray.mesh(OUTLINE, edge_length=0.25, smooth=False, clean=False)
    assert mesh.quality()["eta"] >= raw.quality()["eta"]
    np.testing.assert_array_equal(raw.vertices, mesh.result.raw.vertices)


def test_figures_and_files(mesh: freemesh_ray.Mesh, tmp_path: Path) -> None:
    assert 0.0 < mesh.quality()["eta"] <= 1.0
    for suffix in (".inp", ".msh", ".vtu", ".bdf", ".obj", ".png", ".svg", ".html"):
        mesh.write(tmp_path / f"part{suffix}")
        assert (tmp_path / f"part{suffix}").stat().st_size > 0


def test_several_polygons_are_one_mesh_of_several_regions() -> None:
    polygons = shapely.MultiPolygon([shapely.box(0, 0, 1, 1), shapely.box(2, 0, 3, 1)])
    mesh = freemesh_ray.mesh(polygons, edge_length=0.2)
    assert mesh.defects(area=2.0) == []
    assert {name: len(elements) for name, elements in mesh.groups.regions.items()} == {"region_1": 25, "region_2": 25}


@pytest.mark.parametrize("path", SHIPPED.values(), ids=list(SHIPPED))
def test_shipped_policies_tell_where_they_come_from(path: Path) -> None:
    about = Policy.load(path).about
    assert about["config"]["seed"] == 356
    assert len(about["mlflow.source.git.commit"]) == 40
    assert path.name in (path.parent / "README.md").read_text()


@pytest.mark.slow
def test_the_density_decides_how_many_elements() -> None:
    """Over several domains: on a single one the three trainings may well agree."""
    outlines = [load(name).vertices for name in ("D1", "D5", "D6", "D7")]
    counts = [
        sum(len(freemesh_ray.mesh(outline, density=density).quads) for outline in outlines)
        for density in ("sparse", "medium", "dense")
    ]
    assert counts == sorted(counts)


@pytest.mark.parametrize("count", [12, 31, 60])
def test_even_elements_are_as_long_as_the_boundary_s_segments(count: int) -> None:
    mesh = freemesh_ray.mesh([[0, 0], [2, 0], [2, 1], [0, 1]], edge_length=1 / count, density="even")
    assert len(mesh.quads) == 2 * count**2
    assert mesh.quality()["singularity"] == 0
    corners = mesh.vertices[mesh.quads]
    lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    assert lengths.max() * count < 1.05


@pytest.mark.slow
def test_meshing_needs_neither_ray_nor_torch_nor_mlflow() -> None:
    code = (
        "import sys, freemesh_ray;"
        "freemesh_ray.mesh([[0, 0], [2, 0], [2, 1], [0, 1]], edge_length=0.25);"
        "heavy = {'ray', 'torch', 'mlflow'} & set(sys.modules); assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("suffix", polygon_to_mesh.SUFFIXES)
def test_no_folder_is_made(tmp_path: Path, suffix: str) -> None:
    mesh = freemesh_ray.mesh([[0, 0], [1, 0], [1, 1], [0, 1]])
    path = tmp_path / "none" / f"mesh{suffix}"
    with pytest.raises(OutputError, match=f"there is no folder {path.parent}: `mkdir -p {path.parent}` makes it"):
        mesh.write(path)
    assert list(tmp_path.iterdir()) == []
