"""The peers: they mesh the polygon given and nothing else, and what they cannot do is one line."""

from __future__ import annotations

import os
import sys

import numpy as np
import pytest

from envs.domains.load import from_rings, load
from envs.polygons.rings import loops
from envs.types import Domain
from freemesh_ray.cli.compare import NAMES
from freemesh_ray.compare.gmsh_mesher import VARIANTS, gmsh_mesh, started
from freemesh_ray.compare.isolated import isolated
from freemesh_ray.compare.meshers import PEERS, peers
from freemesh_ray.compare.mixed_mesh import MixedMesh, PeerError
from freemesh_ray.compare.netgen_mesher import netgen_mesh
from freemesh_ray.meshes.metrics import measure


def covered(mesh: MixedMesh) -> float:
    """The elements' areas added up."""
    total = 0.0
    for elements in (mesh.quads, mesh.triangles):
        x, y = np.moveaxis(mesh.vertices[elements], -1, 0)
        total += 0.5 * float((x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum())
    return total


@pytest.mark.parametrize("domain", [load("T1"), load("D9"), load("part:9")], ids=lambda domain: domain.name)
@pytest.mark.parametrize("name", ["gmsh-default", "gmsh-8", "gmsh-quasi", "netgen"])
def test_peers_fill_the_domain_and_keep_its_boundary(name: str, domain: Domain) -> None:
    pytest.importorskip(PEERS[name].module)
    made = PEERS[name].mesh(domain)
    assert made.mesher == name
    assert made.keeps(domain)
    assert covered(made) == pytest.approx(domain.area, rel=1e-9)
    assert made.seconds > 0
    assert len(made.quads) > 2 * len(made.triangles)


@pytest.mark.parametrize("name", ["T1", "T3", "part:5"])
def test_full_quad_gives_quads_alone_on_the_given_boundary(name: str) -> None:
    pytest.importorskip("gmsh")
    domain = load(name)
    made = gmsh_mesh(domain, "gmsh-full-quad")
    assert len(made.triangles) == 0
    assert made.keeps(domain)
    assert covered(made) == pytest.approx(domain.area, rel=1e-9)


def test_the_same_domain_gives_the_same_mesh() -> None:
    pytest.importorskip("gmsh")
    first, second = (gmsh_mesh(load("T1"), "gmsh-8") for _ in range(2))
    np.testing.assert_array_equal(first.quads, second.quads)
    np.testing.assert_array_equal(first.vertices, second.vertices)


def test_a_square_of_squares_is_perfect() -> None:
    pytest.importorskip("gmsh")
    side = np.arange(6.0)
    ring = [*((x, 0) for x in side), *((6, y) for y in side), *((6 - x, 6) for x in side), *((0, 6 - y) for y in side)]
    found = measure(gmsh_mesh(from_rings(ring), "gmsh-8"))
    assert (found["elements"], found["triangles"], found["singularity"]) == (36, 0, 0)
    assert found["eta"] == pytest.approx(1.0, abs=1e-6)


def test_pairs_keep_the_corners() -> None:
    domain = from_rings([[1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1], [0, 0]])
    (loop,) = loops(domain.segments)
    kept = domain.points[started(domain, loop)[::2]]
    assert {tuple(point) for point in kept.tolist()} == {(0, 0), (2, 0), (2, 2), (0, 2)}


def test_odd_loops_have_no_pairs() -> None:
    outer = [[0, 0], [4, 0], [8, 0], [8, 8], [0, 8]]
    with pytest.raises(PeerError, match="loop of 5 vertices"):
        started(domain := from_rings(outer, [[[3, 3], [5, 3], [4, 5]]]), loops(domain.segments)[0])


def test_the_names_are_those_of_the_command() -> None:
    assert tuple(PEERS) == NAMES
    assert set(VARIANTS) < set(NAMES)


def test_what_is_not_installed_is_left_out_with_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gmsh", None)
    monkeypatch.setitem(sys.modules, "netgen.geom2d", None)
    lines: list[str] = []
    assert peers(NAMES, lines.append) == []
    assert len(lines) == 2
    assert "pip install gmsh" in lines[0]
    assert "pip install netgen-mesher" in lines[1]


def test_netgen_keeps_unequal_segments() -> None:
    pytest.importorskip("netgen.geom2d")
    domain = load("D9")
    lengths = np.linalg.norm(np.diff(domain.points[domain.segments], axis=1)[:, 0], axis=1)
    assert lengths.max() > 2 * lengths.min()
    assert netgen_mesh(domain).keeps(domain)


def test_gmsh_leaves_broken_pipes_an_error() -> None:
    pytest.importorskip("gmsh")
    gmsh_mesh(load("T1"), "gmsh-default")
    end, other = os.pipe()
    os.close(end)
    with pytest.raises(BrokenPipeError):
        os.write(other, b"x")
    os.close(other)


def dies(domain: Domain, name: str) -> MixedMesh:
    """A mesher that takes its process down."""
    os.abort()


def fails(domain: Domain, name: str) -> MixedMesh:
    """A mesher that fails."""
    raise PeerError(f"{name}: no")


def test_a_crash_in_a_process_of_its_own_is_a_failure() -> None:
    with pytest.raises(PeerError, match="crashed"):
        isolated(dies, load("T1"), "x")
    with pytest.raises(PeerError, match="x: no"):
        isolated(fails, load("T1"), "x")
