"""Places where a boundary's own segments are too coarse: long beside what is near, or beside what is much shorter.

::

    +-----------------------------------+      The upper side is one segment, eight times as long as its distance
    |        _____                      |      from the hole, and twenty times as long as the hole's segments: what is
    |       /hole \\                     |      between them can only be slivers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from envs.polygons.rings import loops, signed_area
from envs.types import RELATIVE_TOLERANCE, Domain, Floats, Ints

#: Where nothing is refined, sizes grow by this share of a distance, as those of the mesher's own boundaries.
GROWTH = 0.25

#: A segment is too long when it is so many times as long as its distance from what faces it, ...
GAP = 8.0

#: ... or as the size that has grown to it from another, ...
UNEVEN = 5.0

#: ... or fewer times, when such segments are more than this share of the boundary's length.
OFTEN_UNEVEN, SHARE = 3.0, 0.2

#: Elements wanted across a gap.
ACROSS = 2.0

#: The longest segments, which are looked at.
MOST_SEGMENTS = 5_000

#: An edge length that asks for more elements than this is not suggested; one for so many, with a grading, is ...
MOST_ELEMENTS, USUAL_ELEMENTS = 20_000, 2_000

#: ... of at most this.
LARGEST_GRADING = 1000.0


@dataclass(frozen=True)
class CoarsePlace:
    """A segment that is too long for what is near.

    Attributes:
        x, y: halfway between the two; the segment's middle, where they meet.
        length: the segment's, in domain units.
        apart: the distance of what is near, in domain units; 0: they meet.
        other: how long the segment is that is near, in domain units.
        excess: how many times too long it is.
    """

    x: float
    y: float
    length: float
    apart: float
    other: float
    excess: float

    @property
    def wanted(self) -> float:
        """The edge length that would do there, in domain units."""
        return min(self.other, self.apart / ACROSS) if self.apart * GAP <= self.length and self.apart else self.other


def coarse_places(domain: Domain) -> list[CoarsePlace]:
    """The segments that are too long, the worst first, each once; none where the boundary is well discretised.

    A domain of four vertices is one element; it has none.
    """
    if len(domain.ring) <= 4:
        return []
    kept = domain.kept
    ends = domain.points[kept]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    longest = np.argsort(-lengths, kind="stable")[:MOST_SEGMENTS]
    sides = shapely.linestrings(ends)
    inside = solid(domain)
    i, j = (np.concatenate(both) for both in zip(facing(kept, sides, lengths, longest),
                                                 shorter(sides, lengths, longest), strict=True))  # fmt: skip
    apart = shapely.distance(sides[i], sides[j])
    apart[apart <= RELATIVE_TOLERANCE * domain.diameter] = 0.0
    middles = shapely.get_coordinates(shapely.shortest_line(sides[i], sides[j])).reshape(-1, 2, 2).mean(axis=1)
    middles = np.where(apart[:, None] > 0.0, middles, ends[i].mean(axis=1))
    valid = (apart == 0.0) | shapely.contains_xy(inside, middles)
    neighbours = (kept[i][:, :, None] == kept[j][:, None, :]).any(axis=(1, 2))
    uneven = lengths[i] / (lengths[j] + GROWTH * apart)
    with np.errstate(divide="ignore"):
        gap = np.where(neighbours | (apart == 0.0), 0.0, lengths[i] / apart)
    often = valid & (uneven >= OFTEN_UNEVEN)
    least = OFTEN_UNEVEN if lengths[np.unique(i[often])].sum() > SHARE * lengths.sum() else UNEVEN
    excess = np.where(valid, np.maximum(uneven / least, gap / GAP), 0.0)
    order = np.argsort(-excess, kind="stable")
    order = order[excess[order] >= 1.0]
    order = order[np.sort(np.unique(i[order], return_index=True)[1])]
    return [
        CoarsePlace(*middles[k].tolist(), *(float(each[k]) for each in (lengths[i], apart, lengths[j], excess)))
        for k in order.tolist()
    ]


def facing(kept: Ints, sides: np.ndarray, lengths: Floats, longest: Ints) -> tuple[Ints, Ints]:
    """Pairs of one of the longest segments and one without a common end that is near for its length."""
    i, j = shapely.STRtree(sides).query(sides[longest], predicate="dwithin", distance=lengths[longest] / GAP)
    i = longest[i]
    apart = ~(kept[i][:, :, None] == kept[j][:, None, :]).any(axis=(1, 2))
    return i[apart], j[apart]


def shorter(sides: np.ndarray, lengths: Floats, longest: Ints) -> tuple[Ints, Ints]:
    """Pairs of one of the longest segments and the nearest of those that are half as long, a quarter, ..., or less."""
    shortness = np.floor(np.log2(lengths.max() / lengths)).astype(np.int64)
    pairs = [np.zeros((2, 0), dtype=np.int64)]
    for level in np.unique(shortness).tolist():
        members = np.flatnonzero(shortness == level)
        asked = longest[shortness[longest] < level]
        if len(asked):
            found, near = shapely.STRtree(sides[members]).query_nearest(sides[asked], all_matches=False)
            pairs.append(np.stack([asked[found], members[near]]))
    i, j = np.concatenate(pairs, axis=1)
    return i, j


def solid(domain: Domain) -> shapely.Polygon:
    """What a domain covers, prepared to be asked often."""
    rings = [domain.points[loop] for loop in loops(domain.segments)]
    outer = max(range(len(rings)), key=lambda r: signed_area(rings[r]))
    polygon = shapely.Polygon(rings[outer], [ring for r, ring in enumerate(rings) if r != outer])
    shapely.prepare(polygon)
    return polygon


def suggestion(places: Sequence[CoarsePlace], area: float) -> str:
    """The options that split a boundary finely enough: ``--edge-length 0.2``, with a ``--grading`` for large domains.

    Args:
        places: the worst first, at least one.
        area: of the domain, in domain units squared.
    """
    wanted = places[0].wanted
    if area <= MOST_ELEMENTS * wanted**2:
        return f"--edge-length {wanted:.2g}"
    usual = (area / USUAL_ELEMENTS) ** 0.5
    return f"--edge-length {usual:.2g} --grading {min(np.ceil(usual / wanted), LARGEST_GRADING):.0f}"
