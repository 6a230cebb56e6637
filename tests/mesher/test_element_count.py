"""How large a mesh will be is told from its boundary; too large ones are refused before memory is taken."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from traced_memory import little_memory

import freemesh_ray
from envs.domains.load import from_object, load, load_all
from envs.errors import UserError
from envs.polygons.element_count import MOST_ELEMENTS, check_elements, expected_in_domain, expected_in_rings
from envs.types import Domain
from freemesh_ray.cli import command
from freemesh_ray.mesher import domain_to_mesh, mesh_domain
from freemesh_ray.policies.policy import SHIPPED, Policy
from freemesh_ray.storage import free_memory

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
#: 6,250,000 squares, by 10,000 boundary segments.
SMALL = 4e-4


def divided_square(*counts: int) -> Domain:
    """A square whose sides have these numbers of segments."""
    sides = [a + (b - a) * np.linspace(0, 1, n, endpoint=False)[:, None]
             for a, b, n in zip(SQUARE, np.roll(SQUARE, -1, axis=0), counts, strict=True)]  # fmt: skip
    return from_object(np.concatenate(sides))[0]


@pytest.mark.slow
@pytest.mark.parametrize("density", SHIPPED)
def test_meshes_are_about_as_large_as_expected(density: str) -> None:
    policy = Policy.load(SHIPPED[density])
    domains = [load(name) for name in ("T1", "T2", "T3", "D1", "D4", "D7", "D9", "random-3", "part-5", "part-7")]
    domains += [load(name, edge_length=size, grading=4.0) for name, size in (("D9", 1.0), ("part-9", 2.0))]
    domains += [divided_square(n, n, n, n) for n in (5, 33)]
    uneven = [divided_square(200, 20, 20, 20), divided_square(200, 1, 1, 2)]
    for group, least in ((domains, 0.3), (uneven, 0.05)):
        for domain in group:
            made = len(mesh_domain(policy, domain, clean=False).raw.quads) / expected_in_domain(domain)
            assert least < made < 2.5, domain.name


@pytest.mark.slow
@given(scale=st.floats(1e-6, 1e6), width=st.floats(0.1, 10), size=st.floats(0.01, 0.05))
def test_the_expectation_before_the_boundary_is_split_is_the_one_after(scale: float, width: float, size: float) -> None:
    outer = SQUARE * [width, 1.0] * scale
    hole = (SQUARE * 0.3 + 0.3) * [width, 1.0] * scale
    for rings in ([outer], [outer[::-1], hole]):
        before = expected_in_rings(rings, size * scale)
        (after,) = from_object([[list(map(list, ring)) for ring in rings]], edge_length=size * scale)
        assert before == pytest.approx(expected_in_domain(after), rel=0.15)


@pytest.mark.parametrize("edge_length", [SMALL, 4e-6, 1e-300])
def test_python_refuses_before_memory_is_taken(edge_length: float, monkeypatch: pytest.MonkeyPatch) -> None:
    freemesh_ray.mesh(SQUARE, edge_length=0.2)
    with pytest.raises(UserError, match=r"polygon: .*edge_length") as error, little_memory(5_000_000):
        freemesh_ray.mesh(SQUARE, edge_length=edge_length)
    assert "\n" not in str(error.value)


def test_a_boundary_given_in_full_is_counted_too(monkeypatch: pytest.MonkeyPatch) -> None:
    domain = from_object(SQUARE, edge_length=SMALL, allow_large=True)[0]
    monkeypatch.setattr(domain_to_mesh, "mesh_once", lambda *_: pytest.fail("begun"))
    with (
        pytest.raises(UserError, match=r"polygon: a mesh of about 6,25\d,\d{3} elements.*--yes"),
        little_memory(5_000_000),
    ):
        mesh_domain(Policy.load(SHIPPED["medium"]), domain)


@pytest.mark.slow
@pytest.mark.parametrize("ask", [
    lambda: freemesh_ray.mesh(SQUARE, edge_length=SMALL, allow_large=True),
    lambda: command.main(["mesh", "square.wkt", "--edge-length", str(SMALL), "-o", "square.obj", "--yes"]),
])  # fmt: skip
def test_what_is_asked_for_is_made(ask: Callable[[], object], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    class BegunError(Exception):
        pass

    def begun(*_: object) -> None:
        raise BegunError

    monkeypatch.chdir(tmp_path)
    Path("square.wkt").write_text("POLYGON ((0 0, 1 0, 1 1, 0 1, 0 0))")
    monkeypatch.setattr(free_memory, "available", lambda: 1e12)
    monkeypatch.setattr(domain_to_mesh, "mesh_once", begun)
    with pytest.raises(BegunError):
        ask()


def test_the_command_tells_the_size_and_begins_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("square.wkt").write_text("POLYGON ((0 0, 1 0, 1 1, 0 1, 0 0))")
    with little_memory(5_000_000):
        assert command.main(["mesh", "square.wkt", "--edge-length", str(SMALL), "-o", "square.obj"]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert "6,255,000" in err
    assert "--yes" in err
    assert not Path("square.obj").exists()


@pytest.mark.parametrize("edge_length", [1e-5, 1e-9, 1e-300])
def test_what_memory_has_no_room_for_is_refused_before_the_outline_is_split(
    edge_length: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    file = Path("square.wkt")
    file.write_text("POLYGON ((0 0, 1 0, 1 1, 0 1, 0 0))")
    freemesh_ray.mesh(file, edge_length=0.2)
    words = r"elements takes .* GB are free: use a larger edge length"
    for polygon in (SQUARE, file):
        with pytest.raises(free_memory.MemoryShortError, match=words), little_memory(5_000_000):
            freemesh_ray.mesh(polygon, edge_length=edge_length, allow_large=True)
    with little_memory(5_000_000):
        assert command.main(["mesh", "square.wkt", "--edge-length", str(edge_length), "-o", "s.obj", "--yes"]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n"), "GB are free" in err) == ("", 1, True)


def test_regions_share_the_memory_that_is_free(monkeypatch: pytest.MonkeyPatch) -> None:
    squares = [[(SQUARE + np.array([2.0 * i, 0.0])).tolist()] for i in range(10)]
    each = domain_to_mesh.BYTES_PER_ELEMENT * expected_in_rings([SQUARE], 0.1)
    monkeypatch.setattr(free_memory, "available", lambda: 5.0 * each)
    freemesh_ray.mesh(squares[:4], edge_length=0.1)
    with pytest.raises(free_memory.MemoryShortError):
        freemesh_ray.mesh(squares, edge_length=0.1)


def test_polygons_of_a_file_are_counted_one_by_one(tmp_path: Path) -> None:
    file = tmp_path / "two.wkt"
    file.write_text("MULTIPOLYGON (((0 0, 1 0, 1 1, 0 1, 0 0)), ((2 0, 3000 0, 3000 3000, 2 3000, 2 0)))")
    with pytest.raises(UserError, match="polygon 1: a mesh of about"):
        load_all(file, edge_length=1.0)
    assert len(load_all(file, edge_length=100.0)) == 2


def test_no_mesh_is_begun_that_memory_has_no_room_for(monkeypatch: pytest.MonkeyPatch) -> None:
    domain = divided_square(10, 10, 10, 10)
    policy = Policy.load(SHIPPED["medium"])
    monkeypatch.setattr(free_memory, "available", lambda: 1e9)
    mesh_domain(policy, domain)
    monkeypatch.setattr(free_memory, "available", lambda: 1e5)
    with pytest.raises(UserError, match=r"polygon: a mesh of about 120 elements takes .* GB are free: use a larger"):
        mesh_domain(policy, domain, allow_large=True)


def test_at_the_limit() -> None:
    check_elements(MOST_ELEMENTS, "part")
    for size in (MOST_ELEMENTS + 1, 1e30, np.inf):
        with pytest.raises(UserError, match="part: "):
            check_elements(size, "part")
