"""What any mesher makes: quadrilaterals, and triangles where it left some."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from envs.mesh import Mesh, edges_of, sides
from envs.types import Domain, Floats, Ints


class PeerError(RuntimeError):
    """A mesher that made no mesh; one line that says why."""


@dataclass(frozen=True)
class MixedMesh:
    """A mesh of four- and three-cornered elements.

    Attributes:
        mesher: what tables and pictures call its maker.
        vertices: (n, 2) float64, all of them used.
        quads: (m, 4) int64 indices into ``vertices``, counter-clockwise but for inverted ones.
        triangles: (t, 3) int64, likewise.
        seconds: wall time of the meshing alone; NaN when unknown.
    """

    mesher: str
    vertices: Floats
    quads: Ints
    triangles: Ints
    seconds: float

    def __len__(self) -> int:
        """Elements of both kinds."""
        return len(self.quads) + len(self.triangles)

    @cached_property
    def edges(self) -> tuple[Ints, Ints]:
        """Distinct undirected edges (e, 2) int64, and how many elements use each, (e,) int64."""
        return edges_of(self.quads, self.triangles)

    @property
    def valence(self) -> Ints:
        """(n,) int64: edges that meet at each vertex."""
        distinct, _ = self.edges
        return np.bincount(distinct.ravel(), minlength=len(self.vertices))

    @property
    def segments(self) -> Ints:
        """(s, 2) int64: the boundary: the edges that one element alone uses."""
        distinct, counts = self.edges
        return distinct[counts == 1]

    @property
    def complete(self) -> bool:
        """Whether its mesher held it to be finished: no other is handed out."""
        return True

    def keeps(self, domain: Domain) -> bool:
        """Whether the boundary edges are exactly the domain's given segments, within a millionth of its diameter."""
        own = np.unique(self.segments)
        distance, nearest = cKDTree(domain.points[: len(domain.segments)]).query(self.vertices[own])
        if len(self.segments) != len(domain.segments) or distance.max() > 1e-6 * domain.diameter:
            return False
        place = np.zeros(len(self.vertices), dtype=np.int64)
        place[own] = nearest
        found = {tuple(edge) for edge in np.sort(place[self.segments], axis=1).tolist()}
        return found == {tuple(edge) for edge in np.sort(domain.segments, axis=1).tolist()}


def assembled(mesher: str, vertices: ArrayLike, quads: ArrayLike, triangles: ArrayLike, seconds: float) -> MixedMesh:
    """A mesh of raw arrays: vertices without use dropped, clockwise elements turned.

    Args:
        mesher: its maker's name.
        vertices: (n, 2).
        quads: (m, 4) indices, or empty.
        triangles: (t, 3) indices, or empty.
        seconds: wall time of the meshing.

    Raises:
        PeerError: there are no elements.
    """
    points = np.asarray(vertices, dtype=np.float64)
    four = np.asarray(quads, dtype=np.int64).reshape(-1, 4)
    three = np.asarray(triangles, dtype=np.int64).reshape(-1, 3)
    if not len(four) + len(three):
        raise PeerError("made no elements")
    used, number = np.unique(np.concatenate([four.ravel(), three.ravel()]), return_inverse=True)
    four, three = number[: four.size].reshape(-1, 4), number[four.size :].reshape(-1, 3)
    points = points[used]
    four, three = counterclockwise(points, [four, three])
    return MixedMesh(mesher, points, four, three, seconds)


def counterclockwise(points: Floats, blocks: Sequence[Ints]) -> list[Ints]:
    """Blocks of elements, (m, k) each, counter-clockwise.

    Where all elements turn alike they are turned together, so that an inverted one is still told from the others;
    else each by itself.
    """
    areas = []
    for elements in blocks:
        x, y = np.moveaxis(points[elements], -1, 0)
        areas.append((x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1))
    walked = np.concatenate([sides(elements).reshape(-1, 2) for elements in blocks])
    if len(np.unique(walked, axis=0)) == len(walked):  # no side is walked twice in one direction
        total = sum(float(area.sum()) for area in areas)
        areas = [np.full(len(area), total) for area in areas]
    return [
        np.where((area < 0)[:, None], elements[:, ::-1], elements) for area, elements in zip(areas, blocks, strict=True)
    ]


def of_mesh(mesh: Mesh, mesher: str, seconds: float) -> MixedMesh:
    """An all-quad mesh as a mixed one."""
    return assembled(mesher, mesh.vertices, mesh.quads, np.empty((0, 3)), seconds)
