"""``freemesh paper``: its grammar and what it calls."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from freemesh_ray.cli.arguments import add_command, whole
from freemesh_ray.cli.compare import peer_names
from freemesh_ray.formatting.terminal import note, say

TABLES = ("scalability", "generalisation", "quality", "observation", "density")

EPILOG = """\
tables:
  scalability      D1-D3: elements, time, elements/s, size at the boundary and inside
  generalisation   D4-D7: completion, actions by type, the front's shape as it is cut
  quality          D7-D9: the eight metrics and their outliers, of the policy alone, with what completes its mesh (raw),
                   smoothed, finished, and of conventional methods
  observation      T1: quality, elements and time by observation range
  density          T1: elements by density weight

examples:
  freemesh paper scalability
  freemesh paper quality --mesh D7:pave=d7.inp --mesh D8:pave=d8.inp --mesh D9:pave=d9.inp --out paper
  freemesh paper observation --policy O1=runs/o1/policy.npz --policy O2=runs/o2/policy.npz
  freemesh paper density T2 --policy dense=runs/dense/policy.npz --policy medium=runs/default/policy.npz
"""


def add(commands: Any) -> None:
    """Add the command to the grammar."""
    paper = add_command(
        commands,
        "paper",
        "the paper's tables, measured anew",
        "Measure one of the paper's tables and set it beside the printed figures.",
        EPILOG,
    )
    paper.add_argument("table", choices=TABLES, metavar="TABLE", help=", ".join(TABLES))
    paper.add_argument("domains", nargs="*", metavar="DOMAIN", help="in place of the paper's, in their order")
    paper.add_argument("--policy", action="append", default=[], metavar="[LABEL=]FILE",
                       help="policy.npz of a training (default: the shipped medium); repeatable, with labels, for "
                       "observation and density")  # fmt: skip
    paper.add_argument("--peers", type=peer_names, default=["gmsh-default"], metavar="NAMES",
                       help="quality: separated by commas, or none (gmsh-default, which is Blossom-Quad)")  # fmt: skip
    paper.add_argument("--mesh", action="append", default=[], metavar="[DOMAIN:]LABEL=FILE",
                       help="quality: a mesh that another program made, as of Pave; repeatable")  # fmt: skip
    paper.add_argument("--episodes", type=whole(1, 1000), default=10, metavar="N",
                       help="observation, density: repetitions (10)")  # fmt: skip
    paper.add_argument("--out", metavar="FOLDER", help="where TABLE.md, and pictures of quality's meshes, are written")


def run(options: argparse.Namespace) -> int:
    """Measure the table, write it and print it.

    Raises:
        DomainError, PolicyError, RunError, MeshFileError, OutputError: what is wrong with the input.
    """
    from freemesh_ray.storage.atomic import check_writable, replacing

    path = Path(options.out) / f"{options.table}.md" if options.out else None
    if path is not None:
        check_writable(path, parents=True)
    made = WRITERS[options.table](options)
    if path is not None:
        with replacing(path) as draft:
            draft.write_text(made, encoding="utf-8")
    say(made, end="")
    if path is not None:
        note(f"written: {path}")
    return 0


def scalability(options: argparse.Namespace) -> str:
    """The table of one policy on domains of growing density."""
    from freemesh_ray.paper_tables.scalability import DOMAINS, scalability

    return scalability(domains(options, DOMAINS), maker(options))


def generalisation(options: argparse.Namespace) -> str:
    """The table of one policy on domains of growing complexity."""
    from freemesh_ray.paper_tables.generalisation import DOMAINS, generalisation

    return generalisation(domains(options, DOMAINS), maker(options))


def quality(options: argparse.Namespace) -> str:
    """The tables of all meshers; their meshes are drawn, too."""
    from freemesh_ray.compare import foreign_mesh, named_meshers, output
    from freemesh_ray.compare.comparison import compare
    from freemesh_ray.compare.stages import stages
    from freemesh_ray.paper_tables.outliers import outliers
    from freemesh_ray.paper_tables.quality import DOMAINS, quality

    found = domains(options, DOMAINS)
    files = foreign_mesh.files(options.mesh, found)
    columns = [*named_meshers.installed_peers(options.peers, note).meshers, *files]
    make = maker(options)
    columns += stages(next(iter(policies(options).values())), make)
    folder = Path(options.out) if options.out else None
    done = compare(found, columns, folder, lambda row: note(output.line(row)))
    note()
    return f"{quality(done)}\n{outliers(done)}"


def observation(options: argparse.Namespace) -> str:
    """The table of policies that see more or less."""
    from freemesh_ray.paper_tables.observation import observation

    return observation(policies(options), domains(options, ["T1"])[0], options.episodes)


def density(options: argparse.Namespace) -> str:
    """The table of policies that mesh more or less densely."""
    from freemesh_ray.paper_tables.density import density

    return density(policies(options), domains(options, ["T1"])[0], options.episodes)


WRITERS = {
    "scalability": scalability,
    "generalisation": generalisation,
    "quality": quality,
    "observation": observation,
    "density": density,
}


def domains(options: argparse.Namespace, names: Sequence[str]) -> list[Any]:
    """The domains asked for, or those of these names."""
    from envs.domains.load import load

    return [load(name) for name in options.domains or names]


def labelled(options: argparse.Namespace) -> dict[str, Path]:
    """Label -> policy file; without a label the folder's name, without one the shipped policy of the paper's MDP."""
    from freemesh_ray.policies.policy import OF_THE_PAPER, PolicyError

    found: dict[str, Path] = {}
    for text in options.policy or [f"shipped={OF_THE_PAPER}"]:
        label, equals, file = text.rpartition("=")
        path = Path(file)
        label = label if equals else path.resolve().parent.name
        if label in found:
            raise PolicyError(f"--policy {text}: {label} is given twice; use another label, LABEL=FILE")
        found[label] = path
    return found


def policies(options: argparse.Namespace) -> dict[str, Any]:
    """Label -> policy."""
    from freemesh_ray.policies.policy import Policy

    return {label: Policy.load(path) for label, path in labelled(options).items()}


def maker(options: argparse.Namespace) -> Any:
    """Our mesher with the one policy that is asked for."""
    from freemesh_ray.compare.our_mesher import maker as make
    from freemesh_ray.policies.policy import PolicyError

    found = labelled(options)
    if len(found) > 1:
        raise PolicyError(f"{options.table} is of one policy, {len(found)} are given; give --policy once")
    return make(next(iter(found.values())))
