"""The peers: they mesh the polygon given and nothing else, and what they cannot do is one line."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from envs.domains.load import from_rings, load
from envs.polygons.rings import loops
from envs.types import Domain
from freemesh_ray.cli import command
from freemesh_ray.compare import gmsh_mesher, named_meshers
from freemesh_ray.compare.boundary_change import boundary_change
from freemesh_ray.compare.child_process import ChildDiedError, in_child_process
from freemesh_ray.compare.gmsh_mesher import VARIANTS, started
from freemesh_ray.compare.mixed_mesh import MixedMesh, PeerError
from freemesh_ray.compare.named_meshers import installed_peers, peer_mesh
from freemesh_ray.compare.peers import PACKAGES, PEERS
from freemesh_ray.mesh_geometry.metrics import measure


def covered(mesh: MixedMesh) -> float:
    """The elements' areas added up."""
    total = 0.0
    for elements in (mesh.quads, mesh.triangles):
        x, y = np.moveaxis(mesh.vertices[elements], -1, 0)
        total += 0.5 * float((x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum())
    return total


@pytest.mark.parametrize("domain", [load("T1"), load("D9"), load("part:9")], ids=lambda domain: domain.name)
@pytest.mark.parametrize("name", ["gmsh-default", "gmsh-8", "gmsh-8-quasi", "netgen"])
def test_peers_fill_the_domain_and_keep_its_boundary(name: str, domain: Domain) -> None:
    pytest.importorskip(PEERS[name].needs)
    made = peer_mesh(domain, name)
    assert made.mesher == name
    assert made.keeps(domain)
    assert covered(made) == pytest.approx(domain.area, rel=1e-9)
    assert made.seconds > 0
    assert len(made.quads) > 2 * len(made.triangles)


def test_quasi_structured_quads_halve_every_segment_and_leave_the_shape() -> None:
    pytest.importorskip("gmsh")
    domain = load("T1")
    made = peer_mesh(domain, "gmsh-quasi")
    change = boundary_change(made, domain)
    assert (change.added, change.lost, change.off) == (len(domain.segments), 0, 0)
    assert change.split
    assert covered(made) == pytest.approx(domain.area, rel=1e-9)


@pytest.mark.parametrize("name", ["T1", "T3", "part:5"])
def test_full_quad_gives_quads_alone_on_the_given_boundary(name: str) -> None:
    pytest.importorskip("gmsh")
    domain = load(name)
    made = peer_mesh(domain, "gmsh-full-quad")
    assert len(made.triangles) == 0
    assert made.keeps(domain)
    assert covered(made) == pytest.approx(domain.area, rel=1e-9)


def test_the_same_domain_gives_the_same_mesh() -> None:
    pytest.importorskip("gmsh")
    first, second = (peer_mesh(load("T1"), "gmsh-8") for _ in range(2))
    np.testing.assert_array_equal(first.quads, second.quads)
    np.testing.assert_array_equal(first.vertices, second.vertices)


def test_a_square_of_squares_is_perfect() -> None:
    pytest.importorskip("gmsh")
    side = np.arange(6.0)
    ring = [*((x, 0) for x in side), *((6, y) for y in side), *((6 - x, 6) for x in side), *((0, 6 - y) for y in side)]
    found = measure(peer_mesh(from_rings(ring), "gmsh-8"))
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


def test_every_variant_of_gmsh_is_a_peer() -> None:
    assert list(VARIANTS) == [name for name, peer in PEERS.items() if peer.module == "gmsh_mesher"]


def test_the_command_lists_them(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        command.main(["compare", "--help"])
    text = capsys.readouterr().out
    for name, peer in PEERS.items():
        (line,) = [line for line in text.splitlines() if line.split()[:1] == [name]]
        assert line.endswith(f"  {peer.meaning}")
    assert f"pip install {' '.join(PACKAGES)}" in text


def test_importing_the_registry_is_light() -> None:
    heavy = ["numpy", "scipy", "numba", "gmsh", "netgen", "meshio"]
    code = f"import sys, freemesh_ray.compare.peers; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    assert done.stdout == "[]\n"


def test_what_is_not_installed_is_left_out_with_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gmsh", None)
    monkeypatch.setitem(sys.modules, "netgen.geom2d", None)
    monkeypatch.setenv("PATH", "")
    lines: list[str] = []
    found = installed_peers(list(PEERS), lines.append)
    assert found.meshers == []
    assert len(lines) == 3
    assert list(found.absent) == list(PEERS)
    assert found.absent["netgen"] == "netgen is not installed; pip install netgen-mesher"
    assert "pip install gmsh" in lines[0]
    assert "pip install netgen-mesher" in lines[1]


def test_a_peer_without_its_libraries_is_left_out_with_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise OSError("libGLU.so.1: cannot open shared object file")

    monkeypatch.setattr(named_meshers, "import_module", missing)
    lines: list[str] = []
    found = installed_peers(["gmsh-default", "gmsh-8"], lines.append)
    assert found.meshers == []
    assert "libGLU.so.1" in found.absent["gmsh-8"]
    assert len(lines) == 1
    assert "libGLU.so.1" in lines[0]


def test_netgen_keeps_unequal_segments() -> None:
    pytest.importorskip("netgen.geom2d")
    domain = load("D9")
    lengths = np.linalg.norm(np.diff(domain.points[domain.segments], axis=1)[:, 0], axis=1)
    assert lengths.max() > 2 * lengths.min()
    assert peer_mesh(domain, "netgen").keeps(domain)


def test_gmsh_leaves_broken_pipes_an_error() -> None:
    pytest.importorskip("gmsh")
    peer_mesh(load("T1"), "gmsh-default")
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


@pytest.mark.slow
def test_a_call_in_a_child_process_may_crash_or_fail() -> None:
    with pytest.raises(ChildDiedError):
        in_child_process(dies, load("T1"), "x")
    with pytest.raises(PeerError, match="x: no"):
        in_child_process(fails, load("T1"), "x")


@pytest.mark.slow
def test_the_crash_of_a_peer_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gmsh_mesher, "mesh", dies)
    with pytest.raises(PeerError, match="crashed"):
        peer_mesh(load("T1"), "gmsh-8-quasi")
