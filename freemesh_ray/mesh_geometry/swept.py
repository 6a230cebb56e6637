"""Plane meshes swept into hexahedra: along a height, or around an axis; what has a name is swept with them.

::

    of the plane mesh    in the solid
    a side               outer faces
    a line inside        inner faces
    a region             hexahedra
    a point              edges; on the axis of revolution a point
    without a name       outer faces over segments: "sides"; of an extrusion "bottom" and "top", of a part of a turn
                         "start" and "end"

So every outer face is in one set. A name of the last row that a part of the mesh has already gets a number, from
``_2`` on. A side on the axis of revolution sweeps nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import count

import numpy as np

from envs.errors import UserError
from envs.mesh import Mesh, edges_of
from envs.polygons.axis import Axis, axis_of
from envs.polygons.rings import extent, place
from envs.types import RELATIVE_TOLERANCE, Floats, Ints
from freemesh_ray.mesh_geometry.axis_core import Core, column_of, disc
from freemesh_ray.mesh_geometry.hexahedra import keys_of, with_middles
from freemesh_ray.mesh_geometry.index import boundary_of
from freemesh_ray.storage import free_memory

#: Hexahedra at most: with middles a million of them take a gigabyte on the way.
MOST_HEXAHEDRA = 5_000_000

#: Bytes that a hexahedron takes, from its sweep to its file, by its order (measured: 2,100, and 2,600 to 3,300).
BYTES_PER_HEXAHEDRON = {1: 2_500, 2: 4_000}

#: Thickness of the last layer over that of the first at most, and the other way round.
MOST_RATIO = 1e3

#: Degrees that a layer of a revolution spans at most; from 180 on it would have no volume.
WIDEST_LAYER = 120.0

#: Degrees that a sector around the axis spans, about.
SECTOR = 90.0

Y_AXIS = axis_of("y", "the y axis")

#: From places (n, 2) of a mesh to where they lie, (n, 3), at stations (n,) of the sweep, 0 to 1.
Placing = Callable[[Floats, Floats], Floats]


@dataclass(frozen=True, eq=False)
class SolidGroups:
    """The parts of a solid mesh that have names; within each kind none overlaps another.

    Attributes:
        faces: (k, 4 or 8) int64 outer faces of each name, counter-clockwise seen from outside; every one in one set.
        interfaces: (k, 4 or 8) int64 faces inside of each name.
        regions: (k,) int64 hexahedra of each name.
        edges: (k, 2 or 3) int64 edges of each name, the middle last.
        points: the node of each name.
    """

    faces: Mapping[str, Ints] = field(default_factory=dict)
    interfaces: Mapping[str, Ints] = field(default_factory=dict)
    regions: Mapping[str, Ints] = field(default_factory=dict)
    edges: Mapping[str, Ints] = field(default_factory=dict)
    points: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, repr=False)
class SweptMesh:
    """Nodes and hexahedra.

    Attributes:
        name: the plane mesh's.
        nodes: (n, 3) float64; corners first, those of an extrusion station by station in the plane mesh's order.
        hexes: (m, 8) int64 corners, or (m, 20) with the middles of the edges, in the order of ``hexahedra``; positive
            volumes, layer by layer, each in the order of the plane mesh's elements, and last what is around the axis.
        groups: the parts that have names.
    """

    name: str
    nodes: Floats
    hexes: Ints
    groups: SolidGroups

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}: {len(self.hexes)} hexahedra, {len(self.nodes)} nodes>"

    @property
    def order(self) -> int:
        """1, or 2 with nodes in the middles of the edges."""
        return 1 if self.hexes.shape[1] == 8 else 2


def extruded(mesh: Mesh, height: float, layers: int, ratio: float = 1.0, *, order: int = 1) -> SweptMesh:
    """The solid between a plane mesh, at z = 0, and itself at a height.

    Args:
        mesh: complete.
        height: above 0, in the mesh's units.
        layers: hexahedra over the height, 1 or more.
        ratio: thickness of the last layer over that of the first, 0.001 to 1000; from one to the next it changes by a
            factor.
        order: 2: with nodes in the middles of edges, those of curved edges on their curves.

    Raises:
        UserError: numbers out of range, a mesh that is not complete, or too many hexahedra.
    """
    _check(mesh, layers, order)
    if not 0.0 < height < np.inf:
        raise UserError(f"{mesh.name}: height {height:g} of an extrusion; give --extrude a number above 0")
    if not 1.0 / MOST_RATIO <= ratio <= MOST_RATIO:
        raise UserError(f"{mesh.name}: ratio {ratio:g} of layers; give one from {1.0 / MOST_RATIO:g} to {MOST_RATIO:g}")
    thickness = ratio ** (np.arange(layers) / max(1, layers - 1))
    stations = np.concatenate([[0.0], np.cumsum(thickness) / thickness.sum()])
    stations[-1] = 1.0

    def at(places: Floats, where: Floats) -> Floats:
        return np.column_stack([places, height * where])

    return _finished(_Sweep(mesh, at, stations, closed=False), ("bottom", "top"), order)


def revolved(
    mesh: Mesh,
    degrees: float,
    layers: int,
    axis: Axis = Y_AXIS,
    *,
    order: int = 1,
) -> SweptMesh:
    """The solid that a plane mesh, at z = 0, leaves behind when it turns around an axis in its plane, first to z > 0.

    A mesh may touch the axis with whole sides of elements: these are swept as grids around the axis (see
    ``axis_core``), and the layers must be a multiple of 8 for a full turn, of 2 for each 90 degrees of a part.

    Args:
        mesh: complete, on one side of the axis.
        degrees: above 0, at most 360, which closes on itself.
        layers: hexahedra around; at least one for every 120 degrees.
        axis: in the plane; by default the y axis.
        order: 2: with nodes in the middles of edges, those around on circles, those of curved edges on their curves.

    Raises:
        UserError: numbers out of range, a mesh that is not complete, one that crosses the axis or touches it in a point
            of an element, or too many hexahedra.
    """
    _check(mesh, layers, order)
    if not 0.0 < degrees <= 360.0:
        raise UserError(f"{mesh.name}: a turn of {degrees:g} degrees; give --revolve a number above 0, at most 360")
    least = int(np.ceil(degrees / WIDEST_LAYER - 1e-9))
    if layers < least:
        raise UserError(f"{mesh.name}: {layers} layers in {degrees:g} degrees; give --layers {least} or more")
    across, off = axis.left, axis.offsets(mesh.vertices)
    if off[np.abs(off).argmax()] < 0.0:
        across, off = -across, -off
    tolerance = RELATIVE_TOLERANCE * extent(mesh.vertices)
    if off.min() < -tolerance:
        raise UserError(
            f"{mesh.name}: the mesh crosses the axis of revolution: {place(mesh.vertices[off.argmin()])} is beyond it; "
            "keep the polygon on one side"
        )

    def at(places: Floats, where: Floats) -> Floats:
        turn = np.radians(degrees) * where
        radius = (places - axis.start) @ across
        flat = axis.projected(places) + np.outer(radius * np.cos(turn), across)
        # At the first station the mesh itself, bit for bit.
        return np.column_stack([np.where(where[:, None] == 0.0, places, flat), radius * np.sin(turn)])

    closed = degrees == 360.0
    sweep = _Sweep(mesh, at, np.linspace(0.0, 1.0, layers + 1), closed)
    touching = off <= tolerance
    if touching.any():
        sectors = max(1, round(degrees / SECTOR))
        if layers % (2 * sectors):
            raise UserError(
                f"{mesh.name}: the mesh touches the axis of revolution at {place(mesh.vertices[off.argmin()])}; there "
                f"{degrees:g} degrees need a multiple of {2 * sectors} layers; give --layers "
                f"{-(-layers // (2 * sectors)) * 2 * sectors}"
            )
        around = disc(sectors, layers // sectors, closed, np.radians(degrees))
        sweep.core = Core(column_of(mesh, touching), around, len(mesh.vertices), len(mesh.vertices) * sweep.rows)
        hexes = len(sweep.core.column.quads) * len(around.quads)
        if hexes > MOST_HEXAHEDRA:
            raise UserError(f"{mesh.name}: {hexes:,} hexahedra around the axis; use fewer --layers")
    return _finished(sweep, ("start", "end"), order)


def _check(mesh: Mesh, layers: int, order: int) -> None:
    """Refuse a mesh that is not complete, layers that are none, and too many hexahedra."""
    if order not in (1, 2):
        raise UserError(f"{mesh.name}: order {order}; hexahedra are of order 1 or 2")
    if not mesh.complete:
        raise UserError(f"{mesh.name}: the mesh is not complete; only a whole one can be swept")
    if layers < 1:
        raise UserError(f"{mesh.name}: {layers} layers; give --layers 1 or more")
    if layers * len(mesh.quads) > MOST_HEXAHEDRA:
        raise UserError(
            f"{mesh.name}: {layers:,} layers of {len(mesh.quads):,} elements, at most {MOST_HEXAHEDRA:,} hexahedra are "
            "possible; use fewer --layers or a larger --edge-length"
        )
    what = f"{mesh.name}: a solid of {layers * len(mesh.quads):,} hexahedra"
    free_memory.check(BYTES_PER_HEXAHEDRON[order] * layers * len(mesh.quads), what, "use fewer --layers")


@dataclass
class _Sweep:
    """A plane mesh on its way. Corner node ``row * vertices + v`` is vertex v at a station; the core's follow.

    Attributes:
        mesh: complete.
        at: where places lie at stations.
        stations: (layers + 1,) from 0 to 1.
        closed: the last station is the first one.
        core: what is around the axis; None: the mesh does not touch it.
    """

    mesh: Mesh
    at: Placing
    stations: Floats
    closed: bool
    core: Core | None = None

    @property
    def rows(self) -> int:
        """Stations that have nodes of their own."""
        return len(self.stations) - self.closed

    def solid(self, ends: tuple[str, str]) -> SweptMesh:
        """The hexahedra of eight nodes; the numbers of nodes are those above, used or not."""
        mesh, core = self.mesh, self.core
        n = len(mesh.vertices)
        nodes = self.at(np.tile(mesh.vertices, (self.rows, 1)), np.repeat(self.stations[: self.rows], n))
        plain = np.arange(len(mesh.quads))
        if core is not None:
            plain = np.setdiff1d(plain, core.column.quads)
        hexes = self._over(mesh.quads[plain])
        if core is not None:
            nodes, hexes = np.concatenate([nodes, self._core_nodes(core)]), np.concatenate([hexes, core.hexes()])
        return SweptMesh(mesh.name, nodes, hexes, self._groups(plain, ends))

    def _groups(self, plain: Ints, ends: tuple[str, str]) -> SolidGroups:
        """Args: the elements that are not part of the core; what the ends are called."""
        mesh, core, named = self.mesh, self.core, _names(self.mesh)
        faces = {name: self._faces(group) for name, group in mesh.groups.sides.items()}
        rest = self._faces(_without_name(mesh))
        if len(rest):
            faces[_free("sides", named)] = rest
        if not self.closed:
            first, last = mesh.quads[plain], mesh.quads[plain] + (self.rows - 1) * len(mesh.vertices)
            if core is not None:
                first = np.concatenate([first, core.strip(core.disc.first)])
                last = np.concatenate([last, core.strip(core.disc.last)])
            faces[_free(ends[0], named)] = first[:, ::-1]
            faces[_free(ends[1], named)] = last
        lines = {name: self._faces(group) for name, group in mesh.groups.lines.items()}
        axis = [] if core is None else core.column.levels.tolist()
        points = mesh.groups.points.items()
        return SolidGroups(
            {name: group for name, group in faces.items() if len(group)},
            {name: group for name, group in lines.items() if len(group)},
            {name: self._region(group, plain) for name, group in mesh.groups.regions.items()},
            {name: self._over(np.array([[point]])) for name, point in points if point not in axis},
            {name: core.node(point) for name, point in points if core is not None and point in axis},
        )

    def _over(self, walks: Ints) -> Ints:
        """(k, c) vertices -> (layers k, 2 c): they at the station before each layer, then they at the one behind it."""
        n, layers = len(self.mesh.vertices), np.arange(len(self.stations) - 1)
        return np.concatenate([np.hstack([walks + i * n, walks + (i + 1) % self.rows * n]) for i in layers])

    def _faces(self, segments: Ints) -> Ints:
        """(k, 2) segments -> the faces over them, (f, 4), counter-clockwise seen from their right."""
        if self.core is None:
            return self._over(segments)[:, [0, 1, 3, 2]]
        column = self.core.column
        radial = column.radial(segments)
        plain = segments[~(radial | column.along(segments))]
        return np.concatenate([self._over(plain)[:, [0, 1, 3, 2]], self.core.faces(segments[radial])])

    def _region(self, quads: Ints, plain: Ints) -> Ints:
        """Elements -> their hexahedra."""
        places = np.flatnonzero(np.isin(plain, quads))
        layers = len(self.stations) - 1
        found = (np.arange(layers)[:, None] * len(plain) + places).ravel()
        if self.core is None:
            return found
        mine, each = np.flatnonzero(np.isin(self.core.column.quads, quads)), self.core.hexes_each
        inside = layers * len(plain) + (mine[:, None] * each + np.arange(each)).ravel()
        return np.concatenate([found, inside])

    def _core_nodes(self, core: Core) -> Floats:
        """The nodes of the core, level by level."""
        axis, rim = self.mesh.vertices[core.column.levels], self.mesh.vertices[core.column.rims]
        flat = axis[:, None] + core.disc.radius[:, None] * (rim - axis)[:, None]
        return self.at(flat.reshape(-1, 2), np.tile(core.disc.turn, len(axis)))

    def middles(self) -> tuple[Floats, Ints]:
        """Where the middles of swept edges lie, (k, 3), and the edges, (k, 2)."""
        mesh, n = self.mesh, len(self.mesh.vertices)
        flat, _ = edges_of(mesh.quads)
        places = _plane_middles(mesh, flat)
        rows = np.arange(self.rows)
        level = (flat + rows[:, None, None] * n).reshape(-1, 2)
        upright = self._over(np.arange(n)[:, None])
        halfway = 0.5 * (self.stations[1:] + self.stations[:-1])
        return np.concatenate([
            self.at(np.tile(places, (self.rows, 1)), np.repeat(self.stations[: self.rows], len(flat))),
            self.at(np.tile(mesh.vertices, (len(halfway), 1)), np.repeat(halfway, n)),
        ]), np.concatenate([level, upright])  # fmt: skip


def _finished(sweep: _Sweep, ends: tuple[str, str], order: int) -> SweptMesh:
    """The solid without nodes that no hexahedron has, with middles where the order asks for them."""
    solid = sweep.solid(ends)
    used = np.unique(solid.hexes)
    number = np.full(len(solid.nodes), -1)
    number[used] = np.arange(len(used))
    groups = solid.groups
    faces, interfaces, edges = (
        {name: number[group] for name, group in kind.items()}
        for kind in (groups.faces, groups.interfaces, groups.edges)
    )
    points = {name: int(number[node]) for name, node in groups.points.items()}
    nodes, hexes = solid.nodes[used], number[solid.hexes]
    if order == 2:
        places, swept = sweep.middles()
        swept = number[swept]
        # Not those that the core has others in place of.
        kept = (swept >= 0).all(axis=1)
        nodes, hexes, every = with_middles(nodes, hexes, swept[kept], places[kept])
        corners = len(used)
        keys = keys_of(every, corners)

        def grown(walks: Ints, pairs: Ints) -> Ints:
            return np.hstack([walks, corners + np.searchsorted(keys, keys_of(walks[:, pairs], corners))])

        around = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
        faces = {name: grown(group, around) for name, group in faces.items()}
        interfaces = {name: grown(group, around) for name, group in interfaces.items()}
        edges = {name: grown(group, around[:1]) for name, group in edges.items()}
    return SweptMesh(solid.name, nodes, hexes, SolidGroups(faces, interfaces, groups.regions, edges, points))


def _plane_middles(mesh: Mesh, edges: Ints) -> Floats:
    """(k, 2) float64: halfway along each edge (k, 2); of one on a curve the curve's place next to that."""
    middles = mesh.vertices[edges].mean(axis=1)
    base = len(mesh.vertices)
    keys, curved = keys_of(edges, base), keys_of(mesh.curved.edges, base)
    for i, curve in enumerate(mesh.curved.curves):
        mine = np.isin(keys, curved[mesh.curved.curve_of == i])
        if mine.any():
            middles[mine] = curve.at(curve.nearest(middles[mine]))
    return middles


def _without_name(mesh: Mesh) -> Ints:
    """(k, 2) int64: the sides that one element alone has and no name covers, the mesh on their left."""
    outer = boundary_of(mesh)
    named = np.concatenate([np.zeros((0, 2), dtype=np.int64), *mesh.groups.sides.values()])
    return outer[~np.isin(keys_of(outer, len(mesh.vertices)), keys_of(named, len(mesh.vertices)))]


def _names(mesh: Mesh) -> set[str]:
    """The names of a mesh's parts, in small letters: many solvers do not tell large ones from them."""
    groups = mesh.groups
    return {name.lower() for kind in (groups.sides, groups.lines, groups.regions, groups.points) for name in kind}


def _free(name: str, taken: set[str]) -> str:
    """The name, with a number where it is taken."""
    return next(each for i in count(1) if (each := name if i == 1 else f"{name}_{i}") not in taken)
