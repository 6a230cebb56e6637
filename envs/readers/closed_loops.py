"""Curves end to end: pieces that meet at their ends become closed loops, and these the faces between them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from envs.polygons.rings import place
from envs.readers.nesting import Rings
from envs.types import DomainError, Floats, Ints


def faces(pieces: Sequence[Floats], ends: Ints, source: str) -> list[list[Rings]]:
    """The faces of each connected component of a drawing.

    Where every end meets one other, a component is a loop and its only face the inside. Where three or more meet,
    pieces are shared between faces: each region that they bound is one.

    Args:
        pieces: each (k, 2), k >= 2, from its start to its end; the pieces meet at their ends alone.
        ends: (p, 2) int64, the nodes that each piece starts and ends at; pieces meet where these are equal.
        source: the name that messages begin with.

    Returns:
        For each component its faces, for each face its rings.

    Raises:
        DomainError: an end that meets no other, or a piece that bounds nothing.
    """
    pieces, ends = without_copies(pieces, ends)
    if not pieces:
        return []
    meeting = np.bincount(ends.ravel())
    for piece, side in np.argwhere(meeting[ends] == 1)[:1]:
        raise DomainError(open_message(pieces, ends, int(piece), int(side), meeting, source))
    size = len(meeting)
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(size, size))
    component_of = connected_components(graph, directed=False)[1][ends[:, 0]]
    order = np.argsort(component_of, kind="stable")
    components = np.split(order, np.flatnonzero(np.diff(component_of[order])) + 1)
    components.sort(key=lambda component: int(component[0]))
    return [
        [[loop(pieces, ends, component)]] if meeting[ends[component]].max() == 2 else regions(pieces, component, source)
        for component in components
    ]


def without_copies(pieces: Sequence[Floats], ends: Ints) -> tuple[list[Floats], Ints]:
    """The pieces, each drawn once and none that starts and ends at one node without leaving it."""
    kept: dict[tuple[int, int, int, tuple[float, ...]], int] = {}
    for i, (piece, (a, b)) in enumerate(zip(pieces, ends.tolist(), strict=True)):
        if a == b and len(piece) == 2:
            continue
        middle = tuple((piece[len(piece) // 2] + piece[(len(piece) - 1) // 2]).tolist()) if len(piece) > 2 else ()
        kept.setdefault((min(a, b), max(a, b), len(piece), middle), i)
    chosen = list(kept.values())
    return [pieces[i] for i in chosen], ends[chosen].reshape(-1, 2)


def loop(pieces: Sequence[Floats], ends: Ints, component: Ints) -> Floats:
    """The ring of pieces that meet two by two, in the direction of the first."""
    at: dict[int, list[int]] = {}
    for i in component.tolist():
        for node in ends[i].tolist():
            at.setdefault(node, []).append(i)
    walked: list[Floats] = []
    piece = int(component[0])
    node = int(ends[piece, 0])
    for _ in component:
        forward = int(ends[piece, 0]) == node
        walked.append(pieces[piece][:-1] if forward else pieces[piece][:0:-1])
        node = int(ends[piece, 1 if forward else 0])
        one, other = at[node]
        piece = other if one == piece else one
    return np.concatenate(walked)


def regions(pieces: Sequence[Floats], component: Ints, source: str) -> list[Rings]:
    """The rings of every region that connected pieces bound."""
    found, strays = regions_and_strays([pieces[i] for i in component.tolist()])
    for stray in strays:
        raise DomainError(
            f"{source}: the curve from {place(stray[0])} to {place(stray[-1])} has the same region on both sides; "
            "remove it, or split the curves where they cross"
        )
    return found


def regions_and_strays(pieces: Sequence[Floats]) -> tuple[list[Rings], list[Floats]]:
    """The rings of every region that pieces bound, and what of the pieces has the same region on both sides.

    Args:
        pieces: each (k, 2); they meet at their ends alone.
    """
    found, cuts, dangles, broken = shapely.polygonize_full([shapely.LineString(piece) for piece in pieces])
    strays = [np.asarray(stray.coords) for stray in (*cuts.geoms, *dangles.geoms, *broken.geoms)]
    rings = [[np.asarray(ring.coords)[:-1] for ring in (r.exterior, *r.interiors)] for r in found.geoms]
    return rings, strays


def open_message(pieces: Sequence[Floats], ends: Ints, piece: int, side: int, meeting: Ints, source: str) -> str:
    """The line for an end that meets no other, with the nearest open end."""
    here = pieces[piece][-side]
    tips = np.array([pieces[i][-s] for i, s in np.argwhere(meeting[ends] == 1) if (i, s) != (piece, side)])
    line = f"{source}: a curve ends at {place(here)} and no other begins there"
    if not len(tips):
        return f"{line}; close the outline"
    gaps = np.linalg.norm(tips - here, axis=1)
    nearest = int(np.argmin(gaps))
    line = f"{line}, the nearest open end is {gaps[nearest]:.3g} away at {place(tips[nearest])}"
    return f"{line}; close the gap, or remove the curve"
