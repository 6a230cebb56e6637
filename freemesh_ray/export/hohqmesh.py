"""HOHQMesh's ISM-v2, ``.ism``: corners, edges, and elements whose curved sides are polynomials.

A curved side has the places at the Chebyshev-Gauss-Lobatto points of its polynomial, which are worked out from those
that the element has. Sides 1 to 4 of an element run from corner 1 to 2, 2 to 3, 4 to 3 and 1 to 4. A side on the
boundary has the name of that part, others have ``---``.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from envs.types import Floats, Ints
from freemesh_ray.export.facets import numbered
from freemesh_ray.export.finite_elements import FiniteElements

#: A side between two elements.
INSIDE = "---"
#: A side is straight whose nodes lie where they would, within this share of its length.
STRAIGHT = 1e-12


def write(mesh: FiniteElements, path: Path) -> None:
    """Write quadrilaterals of order 1 to 4; nodes inside elements are left out."""
    path.write_bytes("\n".join([*_lines(mesh), ""]).encode("ascii"))


def _lines(mesh: FiniteElements) -> Iterator[str]:
    corners = mesh.elements[:, :4]
    known = np.unique(corners)
    number = np.zeros(len(mesh.nodes), dtype=np.int64)
    number[known] = np.arange(1, len(known) + 1)
    edges = _edges(number[corners])
    yield from ("ISM-V2", f"{len(known)} {len(edges)} {len(corners)} {mesh.kind.order}")
    yield from (_point(point) for point in mesh.nodes[known].tolist())
    yield from (" ".join(map(str, edge)) for edge in edges.tolist())
    curves, curved = _curves(mesh)
    names = _names(mesh)
    for i, nodes in enumerate(number[corners].tolist()):
        yield " ".join(map(str, nodes))
        yield " ".join(str(int(flag)) for flag in curved[i])
        for side in np.flatnonzero(curved[i]).tolist():
            yield from (_point(point) for point in curves[i, side].tolist())
        yield " ".join(names[i])


def _point(place: list[float]) -> str:
    return f"{place[0]!r} {place[1]!r} 0.0"


def _edges(corners: Ints) -> Ints:
    """(e, 6): start, end, element on the left and on the right (0: none), the side of each; the last one negative
    where the sides run against each other.
    """
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2)
    number, count = numbered(ends)
    order = np.argsort(number, kind="stable")
    first = np.cumsum(count) - count
    left, two = order[first], count == 2
    right = order[np.minimum(first + 1, len(order) - 1)]
    ways = np.array([1, 1, -1, -1])
    sides = left % 4, right % 4
    # Walking around, neighbours pass their edge in opposite directions.
    sign = -ways[sides[0]] * ways[sides[1]]
    others = np.where(two[:, None], np.stack([right // 4 + 1, sign * (sides[1] + 1)], axis=1), 0)
    table = np.column_stack([ends[left], left // 4 + 1, others[:, 0], sides[0] + 1, others[:, 1]])
    return table[np.argsort(left, kind="stable")]


def _curves(mesh: FiniteElements) -> tuple[Floats, np.ndarray]:
    """(m, 4, order + 1, 2) places along every side, as ISM has them; and which sides are curved, (m, 4) bool."""
    k = mesh.kind.order
    sides = mesh.elements[:, mesh.kind.side_nodes]
    walked = mesh.nodes[np.concatenate([sides[..., :1], sides[..., 2:], sides[..., 1:2]], axis=-1)]
    even = np.arange(k + 1) / k
    chord = walked[..., :1, :] * (1 - even)[:, None] + walked[..., -1:, :] * even[:, None]
    length = np.linalg.norm(walked[..., -1, :] - walked[..., 0, :], axis=-1)
    curved = np.abs(walked - chord).max(axis=(-1, -2)) > STRAIGHT * length
    stations = 0.5 - 0.5 * np.cos(np.pi * np.arange(k + 1) / k)
    places = np.einsum("ij,...jd->...id", _polynomials(even, stations), walked)
    places[..., 0, :], places[..., -1, :] = walked[..., 0, :], walked[..., -1, :]
    places[:, 2:] = places[:, 2:, ::-1]
    return places, curved


def _polynomials(stations: Floats, places: Floats) -> Floats:
    """(p, s): what the polynomials that are 1 at one of s stations and 0 at the others are at p places."""
    columns = []
    for i, station in enumerate(stations):
        others = np.delete(stations, i)
        columns.append(np.prod((places[:, None] - others) / (station - others), axis=1))
    return np.stack(columns, axis=1)


def _names(mesh: FiniteElements) -> list[list[str]]:
    names = [[INSIDE] * 4 for _ in range(len(mesh.elements))]
    for part in mesh.sides:
        for element, side in zip(part.elements.tolist(), part.sides.tolist(), strict=True):
            names[element][side] = part.name
    return names
