"""What was found as tables and CSV."""

from __future__ import annotations

from collections.abc import Sequence

from freemesh_ray.convergence.problem import Problem
from freemesh_ray.convergence.run import Solved
from freemesh_ray.formatting.csv_text import csv_text
from freemesh_ray.formatting.markdown import escaped
from freemesh_ray.formatting.table import markdown


def line(solved: Solved) -> str:
    """One line of progress."""
    place = f"{solved.problem} at {solved.edge_length:g}  {solved.mesher}"
    if solved.errors is None:
        return f"{place}: failed: {solved.failure}"
    errors = ", ".join(f"{name} {error:.3%}" for name, error in solved.errors.items())
    return f"{place}: {solved.elements:,} elements, error {errors}"


def section(problem: Problem, found: Sequence[Solved]) -> str:
    """A problem's table: a line for each mesh, mesher by mesher; what failed below it."""
    header = ["mesher", "edge length", "elements"]
    for name, factor in problem.factors.items():
        header += [f"{name} error", f"times (theory {factor:.2f})"]
    rows = []
    for mesher in dict.fromkeys(solved.mesher for solved in found):
        own = [solved for solved in found if solved.mesher == mesher and solved.errors is not None]
        for i, solved in enumerate(own):
            cells = [mesher, f"{solved.edge_length:g}", f"{solved.elements:,}"]
            for name in problem.factors:
                cells += [f"{_error(solved, name):.4%}", _times(own, i, name)]
            rows.append(cells)
    failures = [f"- {escaped(line(solved))}" for solved in found if solved.errors is None]
    return "\n\n".join([f"## {problem.title}", markdown(header, rows), *(["\n".join(failures)] if failures else [])])


def csv(found: Sequence[Solved]) -> str:
    """A line for each error."""
    rows = [
        [solved.problem, solved.mesher, solved.edge_length, solved.elements, name, error]
        for solved in found
        for name, error in (solved.errors or {}).items()
    ]
    return csv_text(["problem", "mesher", "edge_length", "elements", "norm", "relative_error"], rows)


def _error(solved: Solved, name: str) -> float:
    assert solved.errors is not None
    return solved.errors[name]


def _times(own: Sequence[Solved], i: int, name: str) -> str:
    """What the error is multiplied by from the mesh before, where that has edges of twice the length."""
    if i == 0 or own[i - 1].edge_length != 2 * own[i].edge_length:
        return "-"
    return f"{_error(own[i], name) / _error(own[i - 1], name):.2f}"
