"""A mesh and its mirror image as one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from envs.errors import UserError
from envs.mesh import CurvedEdges, Groups, Mesh
from envs.polygons.axis import Axis
from envs.polygons.rings import extent, place
from envs.types import RELATIVE_TOLERANCE, Curve, Floats, Ints

#: What the mirror image of a named point is called: its name and this.
IMAGE = "_mirrored"


@dataclass(frozen=True, eq=False)
class MirroredCurve:
    """The mirror image of a curve."""

    curve: Curve
    axis: Axis

    def nearest(self, points: Floats) -> Floats:
        """(m,) parameters of the nearest places to (m, 2) points."""
        return self.curve.nearest(self.axis.mirrored(points))

    def at(self, parameters: Floats) -> Floats:
        """(m, 2) places at (m,) parameters."""
        return self.axis.mirrored(self.curve.at(parameters))

    def between(self, a: Floats, b: Floats, fractions: Floats) -> Floats:
        """(m, f, 2) places at (f,) fractions of the way from (m, 2) places a on it to b."""
        places = self.curve.between(self.axis.mirrored(a), self.axis.mirrored(b), fractions)
        return self.axis.mirrored(places.reshape(-1, 2)).reshape(places.shape)


def mirrored(mesh: Mesh, axis: Axis) -> Mesh:
    """A mesh on one side of an axis that it touches, together with its mirror image.

    Sides, regions and lines keep their names and have them in both halves. A side on the axis is one no more: it is a
    line inside of the same name. The image of a named point away from the axis is called as it with ``_mirrored``.

    Args:
        mesh: its vertices on the axis are those within ``RELATIVE_TOLERANCE`` of its diameter.
        axis: what it is mirrored at.

    Returns:
        The vertices of the mesh, bit for bit, then the images of those away from the axis; the quads likewise, the
        image of a corner that was first first again.

    Raises:
        UserError: the mesh crosses the axis, or has no segment on it.
    """
    off, tolerance = axis.offsets(mesh.vertices), RELATIVE_TOLERANCE * extent(mesh.vertices)
    if off[np.abs(off).argmax()] < 0.0:
        off = -off
    if off.min() < -tolerance:
        raise UserError(
            f"{mesh.name}: the mesh crosses the axis {axis}: {place(mesh.vertices[off.argmin()])} is beyond it; keep "
            "the polygon on one side"
        )
    on = off <= tolerance
    if not on[mesh.segments].all(axis=1).any():
        raise UserError(f"{mesh.name}: no side of the mesh lies on the axis {axis}; mirror it at one of its sides")
    image = np.where(on, np.arange(len(on)), len(on) + np.cumsum(~on) - 1)
    groups, curved = mesh.groups, mesh.curved
    inner = {name: group[on[group].all(axis=1)] for name, group in groups.sides.items()}
    lines = {name: _both(group, image[group]) for name, group in groups.lines.items()}
    for name, group in inner.items():
        if len(group):
            lines[name] = np.concatenate([group, lines[name]]) if name in lines else group
    return replace(
        _plain(mesh),
        vertices=np.concatenate([mesh.vertices, axis.mirrored(mesh.vertices[~on])]),
        quads=_both(mesh.quads, image[mesh.quads][:, [0, 3, 2, 1]]),
        segments=_sides(mesh.segments, on, image),
        groups=Groups(
            {name: found for name, group in groups.sides.items() if len(found := _sides(group, on, image))},
            lines,
            {name: _both(group, group + len(mesh.quads)) for name, group in groups.regions.items()},
            _points(groups, on, image),
        ),
        curved=CurvedEdges(
            _both(curved.edges, image[curved.edges]),
            _both(curved.curve_of, curved.curve_of + len(curved.curves)),
            (*curved.curves, *(MirroredCurve(curve, axis) for curve in curved.curves)),
        ),
    )


def _plain(mesh: Mesh) -> Mesh:
    """The mesh as an `envs.mesh.Mesh`, whatever else its class knows."""
    return Mesh(mesh.name, mesh.vertices, mesh.quads, mesh.segments, mesh.complete)


def _both(first: Ints, second: Ints) -> Ints:
    return np.concatenate([first, second])


def _sides(segments: Ints, on: np.ndarray, image: Ints) -> Ints:
    """Segments that do not lie on the axis, and their images, the mesh on the left of both."""
    kept = segments[~on[segments].all(axis=1)]
    return _both(kept, image[kept][:, ::-1])


def _points(groups: Groups, on: np.ndarray, image: Ints) -> dict[str, int]:
    """The vertices of named points and of their images."""
    found = dict(groups.points)
    for name, vertex in groups.points.items():
        if not on[vertex]:
            free = (f"{name}{IMAGE}" if i == 1 else f"{name}{IMAGE}_{i}" for i in count(1))
            found[next(each for each in free if each not in found)] = int(image[vertex])
    return found
