"""Problems with known solutions: solved at the rates of theory on grids, and told as they were found."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from freemesh_ray.cli import convergence as command
from freemesh_ray.cli.command import main
from freemesh_ray.cli.convergence import PROBLEMS
from freemesh_ray.compare.matching import TOLERANCE
from freemesh_ray.compare.mixed_mesh import MixedMesh, PeerError, assembled
from freemesh_ray.compare.named_meshers import Mesher, ours
from freemesh_ray.compare.our_mesher import maker
from freemesh_ray.convergence import cylinder, kirsch, l_shape, laplace, output, square
from freemesh_ray.convergence.problem import Problem, UnsolvableError, circle, polygon
from freemesh_ray.convergence.run import Solved, run
from freemesh_ray.policies.policy import SHIPPED

#: Elements of a grid: squares, triangles, or both, the triangles where x + y < 1.
QUADS, TRIANGLES, BOTH = "quads", "triangles", "both"


def grid(n: int, kind: str = QUADS) -> MixedMesh:
    """A grid of n x n cells on the unit square, sheared a little inside, so that no element is special."""
    x, y = (values.ravel() for values in np.meshgrid(*[np.linspace(0, 1, n + 1)] * 2))
    shear = 0.05 * np.sin(np.pi * x) * np.sin(np.pi * y)
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    cells = np.stack([corner, corner + 1, corner + n + 2, corner + n + 1], axis=1)
    split = np.zeros(len(cells), bool) if kind == QUADS else (x + y)[corner] < (2 if kind == BOTH else 3) / 2
    cut = cells[split]
    triangles = np.concatenate([cut[:, [0, 1, 2]], cut[:, [0, 2, 3]]])
    return assembled("grid", np.stack([x + shear, y - shear], axis=1), cells[~split], triangles, 0.0)


@pytest.mark.parametrize("kind", [QUADS, TRIANGLES, BOTH])
def test_errors_fall_as_theory_says(kind: str) -> None:
    coarse, fine = (square.errors(grid(n, kind)) for n in (32, 64))
    for name, factor in square.SQUARE.factors.items():
        assert fine[name] / coarse[name] == pytest.approx(factor, rel=0.06)


@pytest.mark.parametrize("kind", [QUADS, TRIANGLES, BOTH])
def test_what_the_elements_hold_is_solved_exactly(kind: str) -> None:
    def plane(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 1 + 2 * x - 3 * y

    def gradient(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return 2 + 0 * x, -3 + 0 * y

    assert max(laplace.errors(grid(6, kind), plane, gradient, None).values()) < 1e-12


@pytest.mark.slow
def test_a_finer_boundary_makes_a_solution_more_accurate() -> None:
    make = ours(maker(SHIPPED["even"]))
    found = [solved.errors or {} for solved in run("square", square.SQUARE, [make], 4, lambda solved: None)]
    assert len(found) == 4
    for coarse, fine in itertools.pairwise(found):
        assert fine["H1"] / coarse["H1"] <= 0.52
        assert fine["L2"] / coarse["L2"] <= 0.27


@pytest.mark.slow
def test_the_error_of_a_singular_solution_falls_more_slowly() -> None:
    make = ours(maker(SHIPPED["medium"]))
    found = run("l_shape", l_shape.L_SHAPE, [make], 3, lambda solved: None)
    first, _, last = [solved.errors or {} for solved in found]
    assert last["H1"] / first["H1"] == pytest.approx(l_shape.L_SHAPE.factors["H1"] ** 2, abs=0.09)


@pytest.mark.parametrize("problem", [square, l_shape])
def test_gradients_are_those_of_the_solutions(problem: object) -> None:
    x, y = np.random.default_rng(0).uniform(0.1, 0.9, (2, 50))
    step = 1e-6
    by_x = (problem.exact(x + step, y) - problem.exact(x - step, y)) / (2 * step)  # type: ignore[attr-defined]
    by_y = (problem.exact(x, y + step) - problem.exact(x, y - step)) / (2 * step)  # type: ignore[attr-defined]
    np.testing.assert_allclose(problem.gradient(x, y), [by_x, by_y], atol=1e-6)  # type: ignore[attr-defined]


def test_kirschs_stress_is_that_of_its_displacement_and_leaves_the_hole_free() -> None:
    r, phi = np.random.default_rng(1).uniform([[1.1], [0]], [[3], [2 * np.pi]], (2, 40))
    x, y, step = r * np.cos(phi), r * np.sin(phi), 1e-5

    def by(dx: float, dy: float) -> np.ndarray:
        ahead, behind = kirsch.displacement(x + dx, y + dy), kirsch.displacement(x - dx, y - dy)
        return (np.array(ahead) - np.array(behind)) / (2 * step)

    gradient = np.stack([by(step, 0), by(0, step)], axis=1)
    strain = 0.5 * (gradient + gradient.swapaxes(0, 1))
    np.testing.assert_allclose(kirsch.hooke(strain), kirsch.stress(x, y), atol=1e-8)
    np.testing.assert_allclose(
        kirsch.energy(kirsch.stress(x, y)), (kirsch.stress(x, y) * strain).sum(axis=(0, 1)), atol=1e-8
    )
    normal = np.array([np.cos(phi), np.sin(phi)])
    np.testing.assert_allclose(np.einsum("ij...,j...", kirsch.stress(*normal), normal), 0, atol=1e-12)
    assert kirsch.stress(np.array(0.0), np.array(1.0))[0, 0] == pytest.approx(3)


@pytest.mark.slow
def test_kirschs_error_falls() -> None:
    found = run("kirsch", kirsch.KIRSCH, [ours(maker(SHIPPED["even"]))], 3, lambda solved: None)
    first, _, last = [(solved.errors or {})["energy"] for solved in found]
    assert last / first == pytest.approx(0.25, abs=0.06)
    assert last < 0.04


@pytest.mark.slow
def test_the_drag_of_the_cylinder() -> None:
    mesh = maker(SHIPPED["medium"])(cylinder.domain(0.04)).finished
    assert cylinder.errors(assembled("x", mesh.vertices, mesh.quads, [], 0.0))["drag"] < 0.06
    with pytest.raises(UnsolvableError, match=r"^2 triangles, for which it is not solved$"):
        cylinder.errors(assembled("x", [[0, 0], [1, 0], [1, 1], [0, 1]], [], [[0, 1, 2], [0, 2, 3]], 0.0))


def test_boundaries_are_of_equal_segments() -> None:
    ring = circle((2.0, 1.0), 0.5, 0.1)
    np.testing.assert_allclose(np.hypot(*(ring - [2, 1]).T), 0.5)
    domain = polygon("frame", [(0, 0), (4, 0), (4, 2), (0, 2)], 0.1, ring)
    assert len(domain.segments) == 120 + len(ring)
    assert len(ring) % 4 == 0
    assert domain.area == pytest.approx(8 - np.pi / 4, rel=0.01)


def test_lines_that_fail_are_told_and_leave_no_ratio(capsys: pytest.CaptureFixture[str]) -> None:
    def mesh(domain: object) -> list[MixedMesh]:
        if len(domain.segments) == 8:  # type: ignore[attr-defined]
            raise PeerError("no\nway")
        return [grid(len(domain.segments) // 4)]  # type: ignore[attr-defined]

    problem = Problem("A title", 1.0, square.domain, square.errors, {"H1": 0.5})
    told: list[Solved] = []
    found = run("p", problem, [Mesher("some", mesh)], 4, told.append)
    assert told == found
    assert [solved.failure for solved in found] == ["", "no way", "", ""]
    text = output.section(problem, found)
    assert text.endswith("- p at 0.5  some: failed: no way")
    ratios = [line.split("|")[6].strip() for line in text.splitlines() if line.startswith("| some")]
    assert ratios[:2] == ["-", "-"]
    assert float(ratios[2]) == pytest.approx(found[3].errors["H1"] / found[2].errors["H1"], abs=0.006)  # type: ignore[index]
    assert output.csv(found).splitlines()[1].startswith("p,some,1.0,1,4,,H1,")
    assert len(output.csv(found).splitlines()) == 1 + 2 * 3


def test_at_as_many_elements_the_best_of_the_others_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    asked: list[float] = []

    def resized(domain: object, factor: float) -> MixedMesh:
        asked.append(factor)
        return grid(max(1, round(len(domain.segments) / 2 / factor)))  # type: ignore[attr-defined]

    def plain(domain: object) -> list[MixedMesh]:
        return [grid(len(domain.segments) // 4)]  # type: ignore[attr-defined]

    def fails(domain: object) -> list[MixedMesh]:
        raise PeerError("no way")

    problem = Problem("A title", 1 / 16, square.domain, square.errors, {"H1": 0.5, "L2": 0.25})
    meshers = [
        Mesher("ours", plain),
        Mesher("fine", lambda domain: [grid(50)], resized),
        Mesher("fixed", lambda domain: [grid(8)]),
        Mesher("failing", fails, lambda domain, factor: fails(domain)[0]),
    ]
    found = run("p", problem, meshers, 2, lambda solved: None, matched=True)
    assert all(math.isnan(solved.size_factor) for solved in found if solved.mesher != "fine")
    for level in (found[:4], found[4:]):
        assert level[1].elements == pytest.approx(level[0].elements, rel=TOLERANCE)
        assert level[1].size_factor == pytest.approx(2, rel=0.05)
        assert [solved.remark for solved in level[:3]] == ["", "", "not matched: its sizes cannot be varied"]
        assert [solved.failure for solved in level] == ["", "", "", "no way"]
        assert [solved.vertices for solved in level[:3]] == [
            (round(solved.elements**0.5) + 1) ** 2 for solved in level[:3]
        ]
    text = output.section(problem, found)
    assert "| size x |" in text
    lines = [line for line in text.splitlines() if "best of the others" in line]
    assert [line.split()[1:4] for line in lines] == [
        ["H1", "at", "0.0625:"], ["L2", "at", "0.0625:"], ["H1", "at", "0.03125:"], ["L2", "at", "0.03125:"],
    ]  # fmt: skip
    for line, (solved, name) in zip(lines, itertools.product([found[:3], found[4:7]], problem.factors), strict=True):
        best = min(solved[1:], key=lambda one: one.errors[name])  # type: ignore[index]
        assert f"ours {solved[0].errors[name]:.3%}" in line  # type: ignore[index]
        assert f"best of the others {best.mesher} {best.errors[name]:.3%}" in line  # type: ignore[index]
    alone = run("p", problem, meshers[:1], 1, lambda solved: None, matched=True)
    assert "best of the others" not in output.section(problem, alone)
    assert "size x" not in output.section(problem, alone)


def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["convergence", "square", "kirsch", "--levels", "2", "--out", "out"]) == 0
    out = capsys.readouterr().out
    assert out.count("| freemesh |") == 4
    assert Path("out/convergence.md").read_text() == out
    assert Path("out/convergence.png").stat().st_size > 10_000
    assert main(["convergence", "circle"]) == 2
    assert capsys.readouterr().err == f"freemesh: 'circle': no problem of this name: use {', '.join(PROBLEMS)}\n"


def test_without_the_solver_it_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def missing(name: str) -> None:
        raise ModuleNotFoundError(f"No module named {name!r}", name="skfem")

    monkeypatch.setattr(command, "import_module", missing)
    assert main(["convergence", "square"]) == 2
    told = "freemesh: scikit-fem is not installed, which solves the problems: pip install scikit-fem\n"
    assert capsys.readouterr().err == told
