"""What was found as tables and CSV."""

from __future__ import annotations

import math
from collections.abc import Sequence

from freemesh_ray.convergence.problem import Problem
from freemesh_ray.convergence.run import Solved
from freemesh_ray.formatting.csv_text import csv_text
from freemesh_ray.formatting.markdown import escaped
from freemesh_ray.formatting.table import markdown, number


def line(solved: Solved) -> str:
    """One line of progress."""
    place = _place(solved)
    if solved.errors is None:
        return f"{place}: failed: {solved.failure}"
    errors = ", ".join(f"{name} {error:.3%}" for name, error in solved.errors.items())
    return f"{place}: {solved.elements:,} elements, error {errors}{f'; {solved.remark}' if solved.remark else ''}"


def section(problem: Problem, found: Sequence[Solved]) -> str:
    """A problem's table: a line for each mesh, mesher by mesher; what failed below it, and who is best.

    Where numbers of elements were matched, ``size x`` is the factor of the sizes inside, 1 for the mesher's own.
    """
    matched = any(math.isfinite(solved.size_factor) for solved in found)
    header = ["mesher", "edge length", "elements", "vertices", *(["size x"] if matched else [])]
    for name, factor in problem.factors.items():
        header += [f"{name} error", f"times (theory {factor:.2f})"]
    rows = []
    for mesher in dict.fromkeys(solved.mesher for solved in found):
        own = [solved for solved in found if solved.mesher == mesher and solved.errors is not None]
        for i, solved in enumerate(own):
            cells = [mesher, f"{solved.edge_length:g}", f"{solved.elements:,}", f"{solved.vertices:,}"]
            cells += [number(solved.size_factor, ".2f")] if matched else []
            for name in problem.factors:
                cells += [f"{_error(solved, name):.4%}", _times(own, i, name)]
            rows.append(cells)
    told = [line(solved) for solved in found if solved.errors is None]
    told += [f"{_place(solved)}: {solved.remark}" for solved in found if solved.errors is not None and solved.remark]
    lists = [told, beside(problem, found)]
    below = ["\n".join(f"- {escaped(each)}" for each in lines) for lines in lists if lines]
    return "\n\n".join([f"## {problem.title}", markdown(header, rows), *below])


def beside(problem: Problem, found: Sequence[Solved]) -> list[str]:
    """For each edge length and error the first mesher's, and the best of the others'; nothing where there are none."""
    lines = []
    for edge_length in dict.fromkeys(solved.edge_length for solved in found):
        level = [solved for solved in found if solved.edge_length == edge_length]
        ours, others = level[0], [solved for solved in level[1:] if solved.errors is not None]
        for name in problem.factors if others else ():
            best = min(others, key=lambda solved: _error(solved, name))
            told = f"best of the others {best.mesher} {_error(best, name):.3%} ({best.elements:,} elements)"
            if ours.errors is not None:
                told = f"{ours.mesher} {_error(ours, name):.3%} ({ours.elements:,}), {told}, "
                told += (
                    f"{_error(ours, name) / _error(best, name):.2f} times as much" if _error(best, name) else "exact"
                )
            lines.append(f"{name} at {edge_length:g}: {told}")
    return lines


def csv(found: Sequence[Solved]) -> str:
    """A line for each error."""
    rows = [
        [
            solved.problem,
            solved.mesher,
            solved.edge_length,
            solved.elements,
            solved.vertices,
            solved.size_factor,
            name,
            error,
        ]
        for solved in found
        for name, error in (solved.errors or {}).items()
    ]
    return csv_text(
        ["problem", "mesher", "edge_length", "elements", "vertices", "size_factor", "norm", "relative_error"], rows
    )


def _place(solved: Solved) -> str:
    return f"{solved.problem} at {solved.edge_length:g}  {solved.mesher}"


def _error(solved: Solved, name: str) -> float:
    assert solved.errors is not None
    return solved.errors[name]


def _times(own: Sequence[Solved], i: int, name: str) -> str:
    """What the error is multiplied by from the mesh before, where that has edges of twice the length."""
    if i == 0 or own[i - 1].edge_length != 2 * own[i].edge_length:
        return "-"
    return f"{_error(own[i], name) / _error(own[i - 1], name):.2f}"
