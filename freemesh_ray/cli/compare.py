"""``freemesh compare``: its grammar and what it calls."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from envs.errors import UserError
from freemesh_ray.cli.arguments import add_command, add_fix_parity, add_policy, positive
from freemesh_ray.compare.peers import PACKAGES, PEERS
from freemesh_ray.formatting.terminal import note, say

#: What stands for no policy, or no peers.
NONE = "none"

#: Every peer on a line, its meaning beside it.
LIST = "\n".join(f"  {name:<{max(map(len, PEERS)) + 3}}{peer.meaning}" for name, peer in PEERS.items())

EPILOG = f"""\
examples:
  freemesh compare D7 D8 D9 --out comparison
  freemesh compare part-1 part-2 part.geojson --peers gmsh-default,netgen --policy runs/default/policy.npz
  freemesh compare part-{{1..100}} --peers gmsh-8 --out parts --no-pictures
  freemesh compare plate.dxf --edge-length 0.5 --peers gmsh-8,gmsh-quasi --match-elements
  freemesh compare D7 --mesh pave=d7.inp --policy none

peers:
{LIST}

They need `pip install {" ".join(PACKAGES)}`; fastq, a program of SEACAS, has to be on the path. Ctrl-C leaves what is
finished in the folder.
"""


def peer_names(text: str) -> list[str]:
    """A comma-separated list of peers, for argparse."""
    names = [name.strip() for name in text.split(",") if name.strip() and name.strip() != NONE]
    for name in names:
        if name not in PEERS:
            raise argparse.ArgumentTypeError(f"{name!r} is no peer: use {', '.join(PEERS)} or {NONE}")
    return list(dict.fromkeys(names))


def add(commands: Any) -> None:
    """Add the command to the grammar."""
    compare = add_command(
        commands,
        "compare",
        "our meshes beside those of other meshers",
        "Mesh domains with our mesher and its peers, boundary segments fixed, and measure all alike.",
        EPILOG,
    )
    compare.add_argument("domains", nargs="+", metavar="DOMAIN", help="as of `freemesh mesh`, or part-SEED")
    compare.add_argument("--out", metavar="FOLDER", help="where comparison.md, .csv, .json and pictures are written")
    compare.add_argument("--no-pictures", dest="pictures", action="store_false", help="tables alone")
    compare.add_argument("--peers", type=peer_names, default=list(PEERS), metavar="NAMES",
                         help=f"separated by commas, or {NONE} (default: all)")  # fmt: skip
    compare.add_argument("--mesh", action="append", default=[], metavar="[DOMAIN:]LABEL=FILE",
                         help="a mesh of another program: .inp, .msh, .vtu, .bdf and more; repeatable")  # fmt: skip
    compare.add_argument("--match-elements", action="store_true",
                         help="vary the peers' sizes inside, the boundary kept, until they have as many elements as our"
                         " mesh, within 5%%")  # fmt: skip
    compare.add_argument("--edge-length", type=positive, metavar="L",
                         help="split the outlines into segments of about this length first, for all alike")  # fmt: skip
    add_policy(compare, more=f", or {NONE}")
    add_fix_parity(compare)


def run(options: argparse.Namespace) -> int:
    """Compare, with a line on stderr for each mesh and brief tables on stdout.

    Raises:
        DomainError, PolicyError, RunError, MeshFileError, OutputError: what is wrong with the input.
    """
    from envs.domains.load import load
    from freemesh_ray.compare import foreign_mesh, named_meshers, output
    from freemesh_ray.compare.comparison import compare
    from freemesh_ray.storage.atomic import check_writable

    folder = Path(options.out) if options.out else None
    if folder is not None:
        check_writable(folder / "comparison.md", parents=True)
    if options.match_elements and options.policy == NONE:
        raise UserError("--match-elements matches the elements of our mesh: leave --policy none out")
    domains = [load(name, fix_parity=options.fix_parity, edge_length=options.edge_length) for name in options.domains]
    files = foreign_mesh.files(options.mesh, domains)
    own = [] if options.policy == NONE else [our_mesher(options)]
    peers = named_meshers.installed_peers(options.peers, note)
    columns = [*own, *peers.meshers, *files]
    if not columns:
        raise foreign_mesh.MeshFileError("nothing to compare: give --policy FILE, --mesh LABEL=FILE or --peers NAMES")
    done = compare(
        domains,
        columns,
        folder,
        lambda row: note(output.line(row)),
        drawn=options.pictures,
        absent=peers.absent,
        matched=options.match_elements,
    )
    note()
    say(output.summary([row for entry in done for row in entry.rows], peers.absent))
    note()
    if folder is None:
        note("all metrics and pictures: --out FOLDER")
    else:
        pictures = ", boxes.png, a picture of each domain" if options.pictures else ""
        note(f"written to {folder}: comparison.md, .csv and .json with all metrics{pictures}")
    return 0


def our_mesher(options: argparse.Namespace) -> Any:
    """The mesher of the policy that is asked for, or the shipped one."""
    from freemesh_ray.compare.named_meshers import ours
    from freemesh_ray.compare.our_mesher import maker
    from freemesh_ray.policies.policy import DEFAULT

    return ours(maker(Path(options.policy or DEFAULT)))
