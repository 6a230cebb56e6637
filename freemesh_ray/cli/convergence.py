"""``freemesh convergence``: its grammar and what it calls."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from envs.errors import UserError
from freemesh_ray.cli.arguments import add_command, add_policy, whole
from freemesh_ray.cli.compare import peer_names
from freemesh_ray.formatting.terminal import note, say

if TYPE_CHECKING:
    from freemesh_ray.convergence.problem import Problem
    from freemesh_ray.convergence.run import Solved

#: Problem -> where it is, and what it is.
PROBLEMS = {
    "square": ("SQUARE", "Poisson's equation on the unit square, a smooth solution: H1 and L2"),
    "l_shape": ("L_SHAPE", "Laplace's equation, singular at the re-entrant corner: H1 and L2"),
    "kirsch": ("KIRSCH", "a plate with a hole under tension, plane stress: energy"),
    "cylinder": ("CYLINDER", "the flow around a cylinder in a channel at Re 20: drag; a minute for the third mesh"),
}

EPILOG = f"""\
problems:
{chr(10).join(f"  {name:<11}{text}" for name, (_, text) in PROBLEMS.items())}

examples:
  freemesh convergence square kirsch
  freemesh convergence --levels 4 --peers gmsh-8,gmsh-full-quad --out convergence
  freemesh convergence kirsch --peers gmsh-8,gmsh-full-quad,gmsh-quasi --match-elements

Needs `pip install scikit-fem`, and for peers what `freemesh compare` does.
"""


class SolverMissingError(UserError, RuntimeError):
    """scikit-fem is not installed."""


def add(commands: Any) -> None:
    """Add the command to the grammar."""
    parser = add_command(
        commands,
        "convergence",
        "whether finer meshes make solutions more accurate",
        "Solve problems with known solutions on ever finer meshes: relative errors, and what halving the edges does.",
        EPILOG,
    )
    parser.add_argument("problems", nargs="*", metavar="PROBLEM", help=f"{', '.join(PROBLEMS)} (all but cylinder)")
    parser.add_argument("--levels", type=whole(1, 7), default=3, metavar="N", help="meshes, each twice as fine (3)")
    parser.add_argument("--peers", type=peer_names, default=[], metavar="NAMES",
                        help="of `freemesh compare`, on the same boundary segments (none)")  # fmt: skip
    parser.add_argument("--match-elements", action="store_true",
                        help="with as many elements as ours, within 5%%: see `freemesh compare`")  # fmt: skip
    parser.add_argument("--out", metavar="FOLDER", help="where convergence.md, .csv and .png are written")
    add_policy(parser)


def run(options: argparse.Namespace) -> int:
    """Solve, with a line on stderr for each mesh and a table on stdout for each problem.

    Raises:
        SolverMissingError, PolicyError, OutputError: what is wrong with the input.
    """
    from freemesh_ray.convergence import output
    from freemesh_ray.storage.atomic import check_writable, replacing

    chosen = _chosen(options.problems)
    folder = Path(options.out) if options.out else None
    if folder is not None:
        check_writable(folder / "convergence.md", parents=True)
    problems = {name: _problem(name) for name in chosen}
    found = _found(problems, options)
    text = "\n\n".join(
        output.section(problem, [each for each in found if each.problem == name]) for name, problem in problems.items()
    )
    if folder is not None:
        for path, content in (
            (folder / "convergence.md", f"{text}\n"),
            (folder / "convergence.csv", output.csv(found)),
        ):
            with replacing(path) as draft:
                draft.write_text(content, encoding="utf-8", newline="")
        _draw(problems, found, folder / "convergence.png")
    say(text)
    if folder is not None:
        note(f"written to {folder}: convergence.md, convergence.csv, convergence.png")
    return 0


def _chosen(names: list[str]) -> list[str]:
    for name in names:
        if name not in PROBLEMS:
            raise UserError(f"{name!r}: no problem of this name: use {', '.join(PROBLEMS)}")
    return list(dict.fromkeys(names)) or [name for name in PROBLEMS if name != "cylinder"]


def _problem(name: str) -> Problem:
    try:
        module = import_module(f"freemesh_ray.convergence.{name}")
    except ModuleNotFoundError as error:
        if error.name != "skfem":
            raise
        raise SolverMissingError(
            "scikit-fem is not installed, which solves the problems: pip install scikit-fem"
        ) from None
    found: Problem = getattr(module, PROBLEMS[name][0])
    return found


def _found(problems: Mapping[str, Problem], options: argparse.Namespace) -> list[Solved]:
    from freemesh_ray.compare.named_meshers import installed_peers, ours
    from freemesh_ray.compare.our_mesher import maker
    from freemesh_ray.convergence import output
    from freemesh_ray.convergence.run import run
    from freemesh_ray.policies.policy import DEFAULT

    meshers = [ours(maker(Path(options.policy or DEFAULT))), *installed_peers(options.peers, note).meshers]
    found = []
    for name, problem in problems.items():
        found += run(
            name,
            problem,
            meshers,
            options.levels,
            lambda solved: note(output.line(solved)),
            matched=options.match_elements,
        )
    note()
    return found


def _draw(problems: Mapping[str, Problem], found: list[Solved], path: Path) -> None:
    from freemesh_ray.plots.convergence_plot import Panel, draw_convergence

    panels = []
    for name, problem in problems.items():
        solved = [each for each in found if each.problem == name and each.errors is not None]
        for norm, factor in problem.factors.items():
            lines = {
                mesher: ([one.elements for one in own], [(one.errors or {})[norm] for one in own])
                for mesher in dict.fromkeys(each.mesher for each in solved)
                if (own := [each for each in solved if each.mesher == mesher])
            }
            if lines:
                panels.append(Panel(f"{problem.title}: {norm}", factor, lines))
    if panels:
        draw_convergence(panels, path)
