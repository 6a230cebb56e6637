"""``freemesh mesh``: a polygon's file in, a mesh's files out."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from envs.errors import FAILED
from envs.polygons.sizing import CURVATURE
from envs.readers.formats import FORMATS as READ
from envs.readers.size_input import MEANING
from freemesh_ray.cli import mesh_batch, mesh_diagnosis
from freemesh_ray.cli.arguments import add_command, add_fix_parity, add_policy, positive, whole
from freemesh_ray.cli.left_out import NUMBER, LeftOut
from freemesh_ray.export import FORMATS, MSH_VERSIONS
from freemesh_ray.formatting.terminal import note, paths, say
from freemesh_ray.policies.policy import DENSITY, SHIPPED, Policy

if TYPE_CHECKING:
    from envs.polygons.geometry import Geometry
    from envs.polygons.layers_along import BoundaryLayers
    from freemesh_ray.mesher.polygon_to_mesh import Mesh

#: A mean element quality below this deserves a word on the boundary.
POOR = 0.5

#: What is called with a mesh that was written, its quality and where it is.
Done = Callable[["Mesh", Mapping[str, float], Sequence[Path]], None]

#: Elements that it took more than the policy to find, by where they came from.
REMEDIES = ("next vertex", "wide", "filled")

DESCRIPTION = """\
Mesh a polygon: a file, a name of the catalogue, random-SEED or part-SEED.
"""

EPILOG = """\
examples:
  freemesh mesh part.geojson -o part.inp
  freemesh mesh part.dxf --edge-length 2.5 --grading 3 -o part.msh -o part.png
  freemesh mesh D4 -o d4.html                     a replay of the mesh growing
  freemesh mesh D4 --best-of 8 --quadratic -o d4.bdf
  freemesh mesh parts/*.dxf --edge-length 2 --out meshes --keep-going

Several polygons in a file are regions of one mesh, which share nodes where they share boundary.

polygon files, by their suffix:
"""


def format_lines() -> str:
    """A line for each format that is read, as the help shows it."""
    lines = []
    for format in READ:
        meaning = f"{format.name}: {format.meaning.replace('`', '')}"
        lines.append(
            fill(meaning, 114, initial_indent=f"  {' '.join(format.suffixes):<22}", subsequent_indent=" " * 24)
        )
    return "\n".join(lines)


def add(commands: Any) -> None:
    """Add the command to the grammar."""
    mesh = add_command(commands, "mesh", "mesh a polygon", DESCRIPTION, EPILOG + format_lines())
    mesh.add_argument("domain", metavar="POLYGON", nargs="+")
    mesh.add_argument("-o", "--output", action="append", default=[], metavar="OUT",
                      help=f"file to write: {', '.join(f'{suffix} ({one.name})' for suffix, one in FORMATS.items())}, "
                      ".png, .svg (picture), .html (replay); repeatable")  # fmt: skip
    reading = mesh.add_argument_group("input")
    reading.add_argument("--layer", action="append", default=[], metavar="NAME",
                         help="of a drawing, read this layer alone; repeatable (all that are seen)")  # fmt: skip
    reading.add_argument("--join", type=positive, metavar="L",
                         help="of a drawing, ends so near each other meet (what rounding explains)")  # fmt: skip
    reading.add_argument("--list-names", action="store_true",
                         help="mesh nothing: print the names of sides and regions, and draw them in OUT")  # fmt: skip
    mesh_diagnosis.add(reading)
    boundary = mesh.add_argument_group("boundary")
    boundary.add_argument("--edge-length", type=positive, metavar="L",
                          help="split the outline into pieces of about this length; corners stay "
                          "(default: its vertices as they are)")  # fmt: skip
    boundary.add_argument("--grading", type=positive, default=1.0, metavar="RATIO",
                          help="largest over smallest piece: finer at sharp and re-entrant corners, short sides and "
                          "narrow places (1)")  # fmt: skip
    boundary.add_argument("--curvature", type=positive, default=CURVATURE, metavar="N",
                          help="where the outline is split: pieces for a full turn of an arc, 4 to 180; arcs are those "
                          "of drawings and those that fine vertices follow (%(default)g)")  # fmt: skip
    boundary.add_argument("--size", metavar="SIZE",
                          help="edge lengths by place, of the boundary and inside; an --edge-length bounds them: "
                          f"{MEANING.replace('%', '%%')} (default: those of a .geo's points, if nothing else is "
                          "said)")  # fmt: skip
    boundary.add_argument("--min-size", type=positive, default=0.0, metavar="L",
                          help="with --density even: elements grow inwards to this edge length at least "
                          "(default: the boundary's)")  # fmt: skip
    boundary.add_argument("--max-size", type=positive, default=math.inf, metavar="L",
                          help="elements grow, or shrink, inwards to this edge length, likewise")  # fmt: skip
    boundary.add_argument("--mirror", metavar="AXIS",
                          help="mesh one half and mirror it: the axis of symmetry, x, y, or x0,y0,x1,y1")  # fmt: skip
    boundary.add_argument("--periodic", action="append", nargs=2, default=[], metavar=("A", "B"),
                          help="two sides, one the other shifted or turned, get the same points; "
                          "repeatable")  # fmt: skip
    rows = mesh.add_argument_group("boundary layers")
    rows.add_argument("--boundary-layers", type=whole(1, 200), metavar="N", help="rows of thin quads along sides")
    rows.add_argument("--along", action="append", default=[], metavar="NAME",
                      help="a side that has them, see --list-names; repeatable")  # fmt: skip
    rows.add_argument("--first", type=positive, metavar="H", help="height of the row at the boundary")
    rows.add_argument("--growth", type=positive, default=1.2, metavar="RATIO",
                      help="height of a row over that of the one before it, 1 to 3 (1.2)")  # fmt: skip
    add_fix_parity(boundary)
    boundary.add_argument("--yes", action="store_true", help="make a mesh of more than 2 million elements, too")
    quality = mesh.add_argument_group("quality")
    quality.add_argument("--best-of", type=whole(1, 1000), default=1, metavar="K", help="the best of K meshes (1)")
    quality.add_argument("--seed", type=whole(0, 2**32 - 1), default=0, metavar="N", help="of all draws (0)")
    quality.add_argument("--no-smooth", dest="smooth", action="store_false", help="leave vertices where they were put")
    quality.add_argument("--no-clean", dest="clean", action="store_false", help="leave irregular vertices")
    quality.add_argument("--effort", choices=["quick", "usual", "thorough"], default="usual",
                         help="against irregular nodes, after a local clean-up: how long to fill patches of elements "
                         "anew; quick: not at all; usual: about half a second; thorough: many times as long "
                         "(usual)")  # fmt: skip
    quality.add_argument("--search", action="store_true",
                         help="for each element the best of several of the policy's draws, not its mean")  # fmt: skip
    quality.add_argument("--density", choices=list(SHIPPED), default=DENSITY,
                         help="how large elements grow inside; even: as the boundary's segments, or as --max-size and "
                         "--min-size say (%(default)s)")  # fmt: skip
    add_policy(quality, "the shipped one of that density")
    files = mesh.add_argument_group("files")
    files.add_argument("--split", action="store_true",
                       help="of several regions, a mesh for each: part-0.inp, part-1.inp, ...")  # fmt: skip
    files.add_argument("--keep-going", action="store_true",
                       help="leave out polygons that cannot be meshed, and tell them; exit code 1")  # fmt: skip
    files.add_argument("--quadratic", action="store_true", help="eight nodes an element")
    files.add_argument("--order", type=whole(1, 4), metavar="K",
                       help="(K + 1)^2 nodes an element, those of curved sides on their curves")  # fmt: skip
    files.add_argument("--element-type", metavar="TYPE", help="of .inp files: CPE4, CPS4, CAX4, S4, CPS8, C3D8, ...")
    files.add_argument("--extrude", type=positive, metavar="H", help="hexahedra of this height")
    files.add_argument("--revolve", type=positive, metavar="DEGREES", help="hexahedra around an axis")
    files.add_argument("--layers", type=whole(1, 10**6), metavar="N", help="of hexahedra (1; around: 24)")
    files.add_argument("--axis", default="y", metavar="AXIS", help="to revolve around: x, y, or x0,y0,x1,y1 (y)")
    files.add_argument("--msh-version", choices=MSH_VERSIONS, default=MSH_VERSIONS[0],
                       help=f"of .msh files ({MSH_VERSIONS[0]})")  # fmt: skip
    mesh_batch.add(mesh)


def run(options: argparse.Namespace) -> int:
    """Mesh one file, or many; see `run_one`."""
    if mesh_batch.wanted(options):
        return mesh_batch.run(options, run_one)
    (options.domain,) = options.domain
    return mesh_diagnosis.run(options) if options.diagnose else run_one(options)


def run_one(options: argparse.Namespace, done: Done | None = None) -> int:
    """Mesh, write, and print a line for each polygon.

    Args:
        options: of the command line.
        done: called with each mesh, its ``quality()`` and where it was written, instead of printing a line.

    Raises:
        DomainError, PolicyError, OutputError: what is wrong with the input.
        MeshingError: a domain that has no valid mesh.
    """
    from envs.domains.load import check_known, load_geometry, own_sizes, wanted_sizes
    from envs.polygons.layers_along import with_layers_along
    from envs.readers.size_input import size_of
    from envs.types import Domain, WantedSizes
    from freemesh_ray.cli.kernel_progress import CompilingLine
    from freemesh_ray.mesher import check_memory
    from freemesh_ray.mesher.coarse_outline import coarse_note
    from freemesh_ray.mesher.polygon_to_mesh import SUFFIXES, Mesh, meshed
    from freemesh_ray.mesher.warm_up import NOTICE, warm_up
    from freemesh_ray.mesher.worst_element import worst_note
    from freemesh_ray.plots import SUFFIXES as PICTURES
    from freemesh_ray.storage.atomic import OutputError

    WantedSizes(options.min_size, options.max_size)
    said = None if options.size is None else size_of(options.size)
    outputs = [Path(output) for output in options.output]
    if not outputs and not options.list_names:
        check_known(options.domain)
        raise OutputError("mesh: where to write? give -o OUT, as in -o part.inp")
    check_outputs(outputs, PICTURES if options.list_names else SUFFIXES)
    if options.extrude is not None and options.revolve is not None:
        raise OutputError("mesh: --extrude and --revolve: give one of the two")
    layers = wanted_layers(options)
    left = LeftOut(options.domain)
    own = own_sizes(options.domain) if said is None and options.edge_length is None else None
    geometry = load_geometry(
        options.domain, layers=tuple(options.layer), join=options.join, fix_parity=options.fix_parity,
        edge_length=options.edge_length, grading=options.grading, curvature=options.curvature,
        size=own if said is None else said, allow_large=options.yes, mirror=options.mirror,
        periodic=[(first, second) for first, second in options.periodic],
        room=check_memory, odd=options.list_names and not options.fix_parity,
        left_out=left.polygon if options.keep_going else None,
    )  # fmt: skip
    for told in geometry.notes:
        note(f"{options.domain}: {told}")
    if options.list_names:
        return list_names(geometry, outputs)
    coarse = coarse_note(geometry) if options.edge_length is None and said is None and own is None else ""
    if coarse:
        note(f"{options.domain}: {coarse}")
    if layers is not None:
        geometry = with_layers_along(geometry, layers)
        for told in thinner(geometry):
            note(told)
    policy = Policy.load(options.policy or SHIPPED[options.density])
    warm_up(policy, CompilingLine(sys.stderr, NOTICE).show)
    wishes = {key: getattr(options, key) for key in ("seed", "best_of", "search", "smooth", "clean", "effort")}
    if own is not None:
        note(f"{options.domain}: split by the sizes at its points; --edge-length L splits it evenly")
        said = own if policy.parameters.sized else None

    def sizes(domain: Domain) -> WantedSizes:
        return wanted_sizes(
            domain, said, edge_length=options.edge_length, least=options.min_size, most=options.max_size
        )

    pieces = [geometry]
    if options.split and (len(geometry.regions) > 1 or left):
        pieces = [replace(geometry, name=region.domain.name, regions=(region,)) for region in geometry.regions]
    for i, piece in enumerate(pieces):
        spares = left.domain if options.keep_going and len(geometry.regions) > 1 else None
        sound, results = meshed(piece, policy, sizes, spares, allow_large=options.yes, **wishes)
        if not results:
            continue  # what was wrong is told
        mesh = Mesh.from_results(sound, results)
        number = NUMBER.search(piece.name)  # that of the file, whatever was left out
        called = f"-{number[1] if number else i}" if piece is not geometry else ""
        written = [path.with_stem(path.stem + called) for path in outputs]
        changes = write(mesh, written, options)
        for change in changes if piece.stated else []:  # nobody misses a name that was offered
            note(change)
        figures = mesh.quality(boundary_layers=False)
        (done or tell)(mesh, figures, written)
        worst = worst_note(mesh, coarse.rpartition("; ")[2], but=mesh.layered)
        if worst:
            note(f"{mesh.name}: {worst}")
        if options.edge_length is None and said is None and not coarse and figures["eta"] < POOR:
            note(
                f"{mesh.name}: the {len(mesh.segments)} boundary segments are coarse or uneven; "
                "--edge-length L splits them evenly"
            )
    if left:
        note(left.summary())
    return FAILED if left else 0


def tell(mesh: Mesh, figures: Mapping[str, float], outputs: Sequence[Path]) -> None:
    """Print the line on a mesh that was written, with its ``quality()``."""
    say(mesh_line(mesh, figures, outputs))


def wanted_layers(options: argparse.Namespace) -> BoundaryLayers | None:
    """The boundary layers asked for, if any.

    Raises:
        OutputError: an option without those that it needs.
    """
    from envs.polygons.layers_along import BoundaryLayers
    from freemesh_ray.storage.atomic import OutputError

    given = {"--boundary-layers": options.boundary_layers, "--along": options.along, "--first": options.first}
    lacking = [name for name, value in given.items() if not value]
    if len(lacking) == len(given):
        return None
    if lacking:
        raise OutputError(f"mesh: boundary layers need {' and '.join(lacking)}, too")
    return BoundaryLayers(tuple(options.along), options.boundary_layers, options.first, options.growth)


def thinner(geometry: Geometry) -> list[str]:
    """Where boundary layers are less high than asked for, the worst place of each region, a line each."""
    from envs.polygons.rings import place

    told = []
    for region in geometry.regions:
        limited = () if region.layers is None else region.layers.limited
        if limited:
            where, share = min(limited, key=lambda one: one[1])
            told.append(
                f"{region.domain.name}: boundary layers are less high than asked for at {len(limited)} "
                f"place{'' if len(limited) == 1 else 's'}; at {place(where)} there is room for {share:.0%}"
            )
    return told


def write(mesh: Mesh, outputs: Sequence[Path], options: argparse.Namespace) -> list[str]:
    """Write a mesh, or the hexahedra that it sweeps; what the user is to be told, a line each."""
    from envs.polygons.element_count import check_elements
    from freemesh_ray import export

    wanted = {"version": options.msh_version, "quadratic": options.quadratic, "element_type": options.element_type}
    if options.extrude is None and options.revolve is None:
        return [line for path in outputs for line in mesh.write(path, order=options.order, **wanted)]
    order = 2 if options.quadratic else options.order or 1
    layers = options.layers or (1 if options.revolve is None else 24)
    if not options.yes:
        check_elements(layers * len(mesh.quads), mesh.name)
    solid = (
        mesh.extruded(options.extrude, layers, order=order)
        if options.revolve is None
        else mesh.revolved(options.revolve, layers, options.axis, order=order)
    )
    told: list[str] = []
    for path in outputs:
        if path.suffix.lower() in export.SUFFIXES:
            told += export.write(solid, path, order=order, **wanted)
        else:
            told += mesh.write(path)
    return told


def list_names(geometry: Geometry, pictures: Sequence[Path]) -> int:
    """Print the names of a geometry, and draw them."""
    from freemesh_ray.formatting.table import table
    from freemesh_ray.plots import draw_names

    rows = [("region", region.name, "", f"{region.domain.area:.6g}") for region in geometry.regions if region.name]
    for name in dict.fromkeys(name for region in geometry.regions for name in region.sides):
        ends = [region.domain.points[region.sides[name]] for region in geometry.regions if name in region.sides]
        segments = np.concatenate(ends)
        length = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).sum()
        rows.append(("side" if len(ends) == 1 else "interface", name, str(len(segments) // len(ends)),
                     f"{length / len(ends):.6g}"))  # fmt: skip
    say(
        table(("what", "name", "segments", "length or area"), rows, left=(0, 1))
        if rows
        else f"{geometry.name}: no names"
    )
    for path in pictures:
        draw_names(geometry, path)
    return 0


def check_outputs(paths: Sequence[Path], known: Sequence[str]) -> None:
    """Before any work: every output has a known format and a place that can be written to.

    Raises:
        OutputError: one has not.
    """
    from freemesh_ray.storage.atomic import OutputError, check_writable

    for path in paths:
        if path.suffix.lower() not in known:
            raise OutputError(f"{path}: unknown format {path.suffix or '(none)'}: use one of {', '.join(known)}")
        check_writable(path)


def counted(count: int, thing: str) -> str:
    """``1 quad``, ``2 quads``."""
    return f"{count} {thing}{'' if count == 1 else 's'}"


def mesh_line(mesh: Mesh, figures: Mapping[str, float], outputs: Sequence[Path]) -> str:
    """A line on a mesh that was written, with its ``quality()``.

    One more says how far a split outline is from the given one, and one what recovery was needed, if any.
    """
    made = mesh.result
    line = (
        f"{mesh.name}: {counted(len(mesh.quads), 'quad')} in {1e3 * made.seconds_finished:.0f} ms, "
        f"{'' if mesh.layered is None else f'{int(mesh.layered.sum())} in boundary layers, the others '}"
        f"eta {figures['eta']:.3f} (5th percentile {figures['eta_p5']:.3f}, least {figures['eta_min']:.3f}), "
        f"{counted(int(figures['singularity']), 'irregular node')} (least {figures['singularity_least']:.0f})"
        f" -> {paths(outputs)}"
    )
    helped = [f"{count} {source}" for source, count in made.sources.items() if count and source in REMEDIES]
    if made.backtracks:
        helped.append(f"{made.backtracks} backtracks")
    lines = [line]
    if made.deviation > 0.0:
        lines.append(f"outline: split, and off the given one by {made.deviation:.3g} at most")
    if helped and len(mesh.quads) > 1:  # an outline of four points is an element
        lines.append(f"recovery: {', '.join(helped)}")
    return f"\n{' ' * len(mesh.name)}  ".join(lines)
