"""The product: an all-quad mesh, with the invariants that every mesh handed out satisfies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from envs.types import Curve, Floats, Ints


def sides(elements: Ints) -> Ints:
    """(m, k) corners -> (m, k, 2) int64: the ends of every element's sides; side i runs from corner i to the next."""
    return np.stack([elements, np.roll(elements, -1, axis=1)], axis=-1)


def edges_of(*blocks: Ints) -> tuple[Ints, Ints]:
    """Distinct undirected edges (e, 2) int64 of blocks of elements, (m, k) each; how many use each, (e,) int64."""
    ends = np.concatenate([sides(elements).reshape(-1, 2) for elements in blocks]).astype(np.int64)
    # One number for each pair: sorting rows takes several times as long.
    base = int(ends.max(initial=0)) + 1
    keys, counts = np.unique(ends.min(axis=1) * base + ends.max(axis=1), return_counts=True)
    return np.stack(np.divmod(keys, base), axis=1), counts


@dataclass(frozen=True, eq=False)
class Groups:
    """The parts of a mesh that have names; within each kind none overlaps another.

    Attributes:
        sides: (k, 2) int64 boundary segments of each name, the domain on their left.
        lines: (k, 2) int64 edges inside of each name: interfaces between regions, lines that elements follow.
        regions: (k,) int64 elements of each name.
        points: the vertex of each name.
    """

    sides: Mapping[str, Ints] = field(default_factory=dict)
    lines: Mapping[str, Ints] = field(default_factory=dict)
    regions: Mapping[str, Ints] = field(default_factory=dict)
    points: Mapping[str, int] = field(default_factory=dict)


#: No names.
NO_GROUPS = Groups()


@dataclass(frozen=True, eq=False)
class CurvedEdges:
    """The edges of a mesh that lie on curves, for elements whose sides are curved.

    Attributes:
        edges: (k, 2) int64 vertices.
        curve_of: (k,) int64, which curve each lies on.
        curves: the curves, exact.
    """

    edges: Ints = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    curve_of: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    curves: tuple[Curve, ...] = ()


#: All edges straight.
STRAIGHT = CurvedEdges()


@dataclass(frozen=True, repr=False)
class Mesh:
    """Vertices and counter-clockwise quadrilaterals.

    Attributes:
        name: the domain's name.
        vertices: (n, 2) float64; the domain's points first, in their order and untouched, then the new ones.
        quads: (m, 4) int64 indices into ``vertices``, counter-clockwise, in the order they were cut.
        segments: (s, 2) int64, the given boundary segments, the domain on their left.
        complete: whether the quads fill the domain.
        groups: the parts that have names.
        curved: the edges that lie on curves.
    """

    name: str
    vertices: Floats
    quads: Ints
    segments: Ints
    complete: bool
    groups: Groups = field(default=NO_GROUPS, kw_only=True)
    curved: CurvedEdges = field(default=STRAIGHT, kw_only=True)

    def __repr__(self) -> str:
        state = "" if self.complete else ", not complete"
        return f"<{type(self).__name__} {self.name}: {len(self.quads)} quads, {len(self.vertices)} vertices{state}>"

    @property
    def triangles(self) -> Ints:
        """(0, 3) int64: none; what measures or draws the meshes of others, too, asks for them."""
        return np.empty((0, 3), dtype=np.int64)

    @property
    def areas(self) -> Floats:
        """(m,) float64: signed areas, positive when counter-clockwise."""
        p = self.vertices[self.quads]
        d, e = p[:, 2] - p[:, 0], p[:, 3] - p[:, 1]
        return 0.5 * (d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0])

    @property
    def edges(self) -> tuple[Ints, Ints]:
        """Distinct undirected edges (e, 2) int64, and how many quads use each, (e,) int64."""
        return edges_of(self.quads)

    @property
    def valence(self) -> Ints:
        """(n,) int64: edges that meet at each vertex."""
        distinct, _ = self.edges
        return np.bincount(distinct.ravel(), minlength=len(self.vertices))

    @property
    def on_boundary(self) -> np.ndarray:
        """(n,) bool: vertices of the given boundary segments."""
        mask = np.zeros(len(self.vertices), dtype=bool)
        mask[self.segments.ravel()] = True
        return mask

    def defects(self, area: float | None = None) -> list[str]:
        """What keeps this from being a valid mesh of its domain; an empty list when nothing does.

        Checked: every quad strictly convex and counter-clockwise, no edge used by more than two quads, and, for a
        complete mesh, that the edges used once are exactly the given boundary segments.

        Args:
            area: the domain's area; when given, the elements' areas must add up to it (relative 1e-9).
        """
        found: list[str] = []
        p = self.vertices[self.quads]
        ahead, behind = np.roll(p, -1, axis=1) - p, np.roll(p, 1, axis=1) - p
        turn = ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]
        bent = int(np.sum((turn <= 0).any(axis=1)))
        if bent:
            found.append(f"{bent} elements are not strictly convex")
        distinct, counts = self.edges
        if (counts > 2).any():
            found.append(f"{int((counts > 2).sum())} edges are shared by more than two elements")
        if self.complete:
            once = {tuple(edge) for edge in distinct[counts == 1].tolist()}
            given = {tuple(edge) for edge in np.sort(self.segments, axis=1).tolist()}
            if once != given:
                found.append(f"{len(once ^ given)} boundary edges differ from the given segments")
            if area is not None and not np.isclose(self.areas.sum(), area, rtol=1e-9, atol=0.0):
                found.append(f"the elements cover {self.areas.sum():.12g} of an area of {area:.12g}")
        return found
