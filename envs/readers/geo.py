"""Gmsh geometry scripts: plane surfaces of lines, circle and ellipse arcs and splines become polygons.

What `geo_statements` understands is read here; of other scripts, those of OpenCASCADE's shapes and Boolean operations
above all, the geometry is asked from Gmsh itself, where it is installed (`geo_gmsh`). Physical groups become names of
sides, regions and places, curves and points in surfaces become lines and places inside. Curves with a transfinite
count keep it unless an edge length is asked for. Without a plane surface the loops are taken, without loops all
curves; loops inside loops are then holes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from envs.polygons import curves
from envs.polygons.curves import Flattening
from envs.polygons.drawing import Drawing, Line, Place, Reading
from envs.polygons.rings import check_coordinates, check_count, extent
from envs.readers import geo_gmsh
from envs.readers.closed_loops import faces
from envs.readers.geo_curves import counted, exact, flattened, reach
from envs.readers.geo_model import CURVE, POINT, SURFACE, Model
from envs.readers.geo_statements import model_of
from envs.readers.geo_words import NotReadError
from envs.readers.nesting import nested
from envs.readers.physical import names_of
from envs.types import DomainError, Floats

#: Places along a curve at most whose sizes are told.
MOST_PLACES = 10_000

#: Out of the plane by at most this share of the extent.
FLAT = 1e-6

FIX = "pip install 'freemesh-ray[gmsh]' to have Gmsh read it, or save the mesh from Gmsh as .msh"


class Flat:
    """The curves of a model as polylines, made when they are asked for.

    Attributes:
        model: it.
        source: the name that messages begin with.
        fineness: how finely.
        keep_counts: whether transfinite curves have the points that they ask for.
    """

    def __init__(self, model: Model, source: str, fineness: Flattening, keep_counts: bool) -> None:
        self.model, self.source, self.fineness, self.keep_counts = model, source, fineness, keep_counts
        self._made: dict[int, Floats] = {}
        self._total = 0

    def __getitem__(self, tag: int) -> Floats:
        if tag not in self._made:
            if self.keep_counts and tag in self.model.counts:
                made = counted(self.model, tag, self.source)
            else:
                made = flattened(self.model, self.model.curves[tag], self.fineness, self.source)
            self._total += len(made)
            check_count(self._total, self.source)
            self._made[tag] = made
        return self._made[tag]


def drawing_of_file(path: Path, reading: Reading) -> Drawing:
    """The plane surfaces in a Gmsh script, and what is named in it.

    Raises:
        DomainError: the line of the script, what is wrong with it, and the fix.
    """
    source = str(path)
    model = read(path)
    if not model.curves:
        raise DomainError(f"{source}: no curves; give Point, Line and Plane Surface statements")
    tags = list(dict.fromkeys(tag for curve in model.curves.values() for tag in curve.points))
    used = np.array([model.points[tag][:2] for tag in tags])
    check_coordinates(used, source, lambda i: f"point {tags[i]}")
    size = extent(np.concatenate([used, *(reach(curve) for curve in model.curves.values())]))
    fineness = curves.flattening(size, reading.edge_length)
    flat = Flat(model, source, fineness, keep_counts=reading.edge_length is None)
    check_flat(model, size, source)
    of_surfaces, notes = names_of("surface", members(model, SURFACE))
    polygons = polygons_of(model, flat, source)
    regions = [of_surfaces.get(tag, "") for tag in model.surfaces]
    lines, of_lines = lines_of(model, flat, source)
    places, of_places = places_of(model)
    return Drawing(
        polygons,
        regions=regions if any(regions) else (),
        lines=lines,
        places=places,
        notes=[*model.notes, *notes, *of_lines, *of_places],
    )


def polygons_of_file(path: Path, edge_length: float | None = None) -> list[list[Any]]:
    """The rings of every plane surface in a Gmsh script."""
    return [list(rings) for rings in drawing_of_file(path, Reading(edge_length)).polygons]


def read(path: Path) -> Model:
    """What a script defines, read here or by Gmsh."""
    try:
        model = model_of(path)
    except NotReadError as error:
        if geo_gmsh.installed():
            return geo_gmsh.model_of(path)
        raise DomainError(f"{error}; {FIX}") from None
    if model.replaceable and geo_gmsh.installed():
        return geo_gmsh.model_of(path)
    if model.replaceable:
        model.notes.append(f"{model.replaceable}: splines of OpenCASCADE's are read as Gmsh's own; {FIX}")
    return model


def members(model: Model, dimension: int) -> list[tuple[int, str, list[int]]]:
    """Number, name and members of the physical groups of a dimension."""
    return [(group.tag, group.name, group.members) for group in model.groups.values() if group.dimension == dimension]


def check_flat(model: Model, size: float, source: str) -> None:
    """Refuse surfaces out of the x, y plane, or out of one that is parallel to it."""
    for tag, edges in model.surfaces.items():
        heights = [model.points[point][2] for edge in edges for point in model.curves[abs(edge)].points]
        if heights and max(heights) - min(heights) > FLAT * size:
            raise DomainError(
                f"{source}: surface {tag} reaches from z = {min(heights):g} to {max(heights):g}; "
                "give surfaces in the x, y plane"
            )


def polygons_of(model: Model, flat: Flat, source: str) -> Sequence[Sequence[Floats]]:
    """The rings of each surface; without surfaces those of the loops, without loops those of all curves."""
    if model.surfaces:
        found, total = [], 0
        for tag, edges in model.surfaces.items():
            rings = rings_of(model, flat, edges, f"{source}: surface {tag}: a loop")
            total += sum(map(len, rings))
            check_count(total, source)
            # The outer one first: it is the largest, whatever the order in the script.
            outer = max(range(len(rings)), key=lambda i: abs(signed_area(rings[i])))
            found.append([rings[outer], *rings[:outer], *rings[outer + 1 :]])
        return found
    if model.loops:
        rings, total = [], 0
        for tag, edges in model.loops.items():
            rings += rings_of(model, flat, edges, f"{source}: loop {tag}")
            total = sum(map(len, rings))
            check_count(total, source)
        return nested([[[ring]] for ring in rings], source)
    node = {tag: i for i, tag in enumerate(model.points)}
    ends = np.array([(node[c.points[0]], node[c.points[-1]]) for c in model.curves.values()], dtype=np.int64)
    return nested(faces([flat[tag] for tag in model.curves], ends, source), source)


def signed_area(ring: Floats) -> float:
    """The area of an (n, 2) ring, positive when it is counter-clockwise."""
    x, y = (ring - ring[0]).T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def rings_of(model: Model, flat: Flat, edges: Sequence[int], where: str) -> list[Floats]:
    """The rings that curves make up, in any order and direction, as Gmsh chains them.

    Args:
        edges: signed tags; each ring begins with the first that is left, and in its direction where the next fits.
        where: how messages begin.
    """
    ends = [(model.curves[abs(tag)].points[0], model.curves[abs(tag)].points[-1]) for tag in edges]
    at: dict[int, list[int]] = {}
    for i in reversed(range(len(edges))):
        for node in ends[i]:
            at.setdefault(node, []).append(i)
    left = dict.fromkeys(range(len(edges)))
    rings = []
    while left:
        i = next(iter(left))
        forward = edges[i] > 0
        following = ends[i + 1] if i + 1 in left else ()
        start, node = ends[i] if forward else ends[i][::-1]
        if node not in following and start in following and start != node:
            forward, start, node = not forward, node, start
        pieces = []
        while True:
            del left[i]
            piece = flat[abs(edges[i])]
            pieces.append(piece[:-1] if forward else piece[:0:-1])
            if node == start:
                break
            while at[node] and at[node][-1] not in left:
                at[node].pop()
            if not at[node]:
                raise DomainError(
                    f"{where} ends at point {node} and not at point {start}, its start; add the curve between"
                )
            i = at[node].pop()
            forward = ends[i][0] == node
            node = ends[i][1] if forward else ends[i][0]
        rings.append(np.concatenate(pieces))
    return rings


def lines_of(model: Model, flat: Flat, source: str) -> tuple[list[Line], list[str]]:
    """The curves that have names, lie inside, or are no straight sides; and notes."""
    names, notes = names_of("curve", members(model, CURVE))
    bounding = {abs(edge) for table in (model.surfaces, model.loops) for edges in table.values() for edge in edges}
    sides = bounding or set(model.curves)
    inside = set(model.embedded_curves)
    lines = []
    for tag, curve in model.curves.items():
        path = exact(model, curve, source) if tag in sides or tag in inside or tag in names else None
        if tag in names or tag in inside or path is not None:
            passing = tag not in sides and tag not in inside
            lines.append(Line(flat[tag], names.get(tag, ""), path, optional=passing))
    return lines, notes


def places_of(model: Model) -> tuple[list[Place], list[str]]:
    """The points that have names or lie inside; and notes."""
    names, notes = names_of("point", members(model, POINT))
    on_curves = {point for curve in model.curves.values() for point in (curve.points[0], curve.points[-1])}
    wanted = dict.fromkeys(model.embedded_points) | {tag: None for tag in names if tag in on_curves}
    off = [tag for tag in names if tag not in wanted and tag in model.points]
    if off:
        notes.append(f"point {off[0]} has a name and lies on no curve, nor in a surface; it is left out")
    return [Place(*model.points[tag][:2], names.get(tag, "")) for tag in wanted if tag in model.points], notes


def sizes_of_file(path: Path) -> Floats | None:
    """The sizes that a script states at its points, along its curves: as in Gmsh, linear from one end to the other.

    Returns:
        (m, 3) float64 rows x, y and a size; None where no end of a curve has one, or where curves are transfinite,
        which have their segments already.

    Raises:
        DomainError: as `drawing_of_file`.
    """
    source = str(path)
    model = read(path)
    if model.counts:
        return None
    rows = [np.zeros((0, 3))]
    for curve in model.curves.values():
        ends = [model.sizes.get(curve.points[end], np.nan) for end in (0, -1)]
        points = flattened(model, curve, curves.flattening(1.0, np.inf), source)
        if np.isnan(ends).any():
            stated = [[*points[-end], ends[end]] for end in (0, 1) if ends[end] > 0.0]
            rows.append(np.array(stated).reshape(-1, 3))
            continue
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        # Sizes grow from each place on: between two of them they must not, by more than the line says.
        places = int(min(2.0 * np.ceil(2.0 * along[-1] / min(ends)) + 1.0, MOST_PLACES)) if ends[0] != ends[1] else 2
        at = np.linspace(0.0, along[-1], places)
        xy = [np.interp(at, along, points[:, axis]) for axis in (0, 1)]
        rows.append(np.column_stack([*xy, np.linspace(ends[0], ends[1], places)]))
    inside = [(*model.points[tag][:2], model.sizes[tag]) for tag in model.embedded_points if tag in model.sizes]
    rows.append(np.array(inside).reshape(-1, 3))
    found = np.concatenate(rows)
    return found if len(found) else None
