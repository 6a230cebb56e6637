"""Structured zones: a grid between four sides, opposite ones of as many segments, by transfinite interpolation.

::

    d----top----c        Sides run counter-clockwise: bottom a b, right b c, top c d, left d a. A node inside is
    |           |        where the lines between opposite points would cross in a unit square whose sides are divided
    left    right        as the zone's; with these shares u and v (Gordon and Hall, Int. J. Numer. Meth. Engng 7, 1973)
    |           |
    a--bottom---b        x = (1 - v) bottom + v top + (1 - u) left + u right - the bilinear map of the corners
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from envs.mesh import Groups, Mesh
from envs.polygons.rings import place
from envs.types import DomainError, Floats, Ints

#: Last over first segment of a side at most, and the other way round.
MOST_RATIO = 1e3


def divided(points: Floats, count: int, ratio: float = 1.0) -> Floats:
    """A line in segments that grow by one factor.

    Args:
        points: (k, 2) from its start to its end.
        count: segments, 1 or more.
        ratio: the last one over the first one, 0.001 to 1000.

    Returns:
        (count + 1, 2) float64, the ends as given.

    Raises:
        DomainError: no such numbers.
    """
    if count < 1 or not 1.0 / MOST_RATIO <= ratio <= MOST_RATIO:
        raise DomainError(
            f"{count} segments, the last {ratio:g} times as long as the first: give 1 segment or more, and a ratio "
            f"from {1.0 / MOST_RATIO:g} to {MOST_RATIO:g}"
        )
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    steps = ratio ** (np.arange(count) / max(1, count - 1))
    wanted = np.cumsum(steps)[:-1] / steps.sum() * along[-1]
    inside = np.stack([np.interp(wanted, along, points[:, axis]) for axis in (0, 1)], axis=1)
    return np.concatenate([points[:1], inside, points[-1:]])


def transfinite(ring: Floats, corners: Sequence[int], name: str, names: Sequence[str] = ("", "", "", "")) -> Mesh:
    """The grid inside a ring with four sides.

    Args:
        ring: (n, 2) float64, counter-clockwise.
        corners: the ring's vertices that its four sides begin at, ascending.
        name: the mesh's, and what messages begin with.
        names: of the sides, the first one from the first corner on; empty: none.

    Returns:
        The mesh; the ring's vertices come first, bit for bit.

    Raises:
        DomainError: opposite sides of different counts, or an element that is not convex.
    """
    sides = [_side(ring, a, b) for a, b in zip(corners, (*corners[1:], corners[0] + len(ring)), strict=True)]
    counts = [len(side) - 1 for side in sides]
    for i in (0, 1):
        if counts[i] != counts[i + 2]:
            ends = [f"from {place(ring[sides[j][0]])} to {place(ring[sides[j][-1]])}" for j in (i, i + 2)]
            raise DomainError(
                f"{name}: the side {ends[0]} has {counts[i]} segments and the opposite one {ends[1]} has "
                f"{counts[i + 2]}; give both as many, or leave the zone unstructured"
            )
    columns, rows = counts[:2]
    number = np.full((columns + 1, rows + 1), -1)
    number[:, 0], number[-1], number[::-1, -1], number[0, ::-1] = sides
    inside = number < 0
    number[inside] = len(ring) + np.arange(int(inside.sum()))
    grid = _placed(*(ring[side] for side in sides))
    quads = np.stack([c.ravel() for c in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])], axis=1)
    walk = np.arange(len(ring))
    mesh = Mesh(
        name,
        np.concatenate([ring, grid[inside]]),
        quads,
        np.stack([walk, np.roll(walk, -1)], axis=1),
        True,
        groups=Groups(_named(sides, names)),
    )
    _check_convex(mesh)
    return mesh


def _side(ring: Floats, start: int, end: int) -> Ints:
    return np.arange(start, end + 1) % len(ring)


def _named(sides: Sequence[Ints], names: Sequence[str]) -> dict[str, Ints]:
    found: dict[str, list[Ints]] = {}
    for side, name in zip(sides, names, strict=True):
        if name:
            found.setdefault(name, []).append(np.stack([side[:-1], side[1:]], axis=1))
    return {name: np.concatenate(parts) for name, parts in found.items()}


def _placed(bottom: Floats, right: Floats, top: Floats, left: Floats) -> Floats:
    """(columns + 1, rows + 1, 2): where the nodes of the grid lie."""
    top, left = top[::-1], left[::-1]
    low, high, first, last = (_shares(side) for side in (bottom, top, left, right))
    across, up = (high - low)[:, None], (last - first)[None]
    u = (low[:, None] + first[None] * across) / (1.0 - across * up)
    v = (first[None] + u * up)[..., None]
    u = u[..., None]
    sides = (1 - v) * bottom[:, None] + v * top[:, None] + (1 - u) * left[None] + u * right[None]
    corners = (1 - v) * ((1 - u) * bottom[0] + u * bottom[-1]) + v * ((1 - u) * top[0] + u * top[-1])
    return np.asarray(sides - corners)


def _shares(side: Floats) -> Floats:
    """(k,) how far along a side its points are, from 0 to 1."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(side, axis=0), axis=1))])
    return np.asarray(along / along[-1])


def _check_convex(mesh: Mesh) -> None:
    """Refuse elements whose Jacobian is not positive at all corners, and so everywhere."""
    corners = mesh.vertices[mesh.quads]
    ahead, behind = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    turn = (ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]).min(axis=1)
    if turn.min() <= 0.0:
        worst = corners[turn.argmin()].mean(axis=0)
        raise DomainError(
            f"{mesh.name}: a structured zone of this shape has an element at {place(worst)} that is not convex; divide "
            "the zone, choose other corners, or leave it unstructured"
        )
