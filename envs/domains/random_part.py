"""Random machine parts: stars, combs, gears, springs, plates, brackets; one seed, one domain. For measuring only.

Nothing trains on these, so a mesher's figures on them tell how it does on polygons it has never met.
"""

from __future__ import annotations

import re

import numpy as np
import shapely

from envs.domains.part_families import FAMILIES
from envs.domains.random_domain import discretised, roomy
from envs.polygons.outline import Spacing, even, near, wave
from envs.polygons.rings import signed_area
from envs.polygons.validation import from_rings
from envs.types import Domain, DomainError, Floats

#: What names of parts begin with, ``part-17``, and what else asks for one: ``part:17``.
PREFIX, SPEC = "part-", "part:"
NAME = re.compile(r"part-\d+", re.IGNORECASE)

#: Least and most given boundary vertices.
FEWEST, MOST = 30, 400

#: Where the vertices drawn cannot follow the polygon, this many times more may.
DENSER = 1.3

#: Most times that a segment is longer than its neighbour, and than the shortest of all.
NEIGHBOURS, ALL = 2.2, 7.0

#: Least share of an outline's area that its vertices enclose: a round hole has 7 of them at least.
LIKENESS = 0.86

#: Polygons tried; the families leave so few to chance that one of the first does.
ATTEMPTS = 200


def random_part(seed: int) -> Domain:
    """The part of a seed: 30 to 400 given vertices, evenly spaced or graded, about a third of them with holes.

    Args:
        seed: 0 to 2**63 - 1.

    Raises:
        DomainError: a seed out of its range.
    """
    if not 0 <= seed < 2**63:
        raise DomainError(f"{PREFIX}{seed}: seed = {seed} is out of range; choose it from 0 to {2**63 - 1}")
    rng = np.random.default_rng(seed)
    # Drawn once: a family whose polygons are refused more often is no rarer.
    family = FAMILIES[rng.integers(len(FAMILIES))]
    for _ in range(ATTEMPTS):
        polygon = family(rng)
        if rng.random() < 0.4:
            polygon = shapely.affinity.rotate(polygon, rng.uniform(0.0, 360.0))
        domain = fitted(rng, polygon, f"{PREFIX}{seed}")
        if domain is not None:
            return domain
    raise AssertionError(f"{PREFIX}{seed}: no {family.__name__} of {ATTEMPTS} makes a domain")


def is_spec(text: str) -> bool:
    """Whether a text asks for a random part."""
    return text.lower().startswith(SPEC) or NAME.fullmatch(text) is not None


def from_spec(spec: str) -> Domain:
    """The part of ``part-SEED`` or ``part:SEED``.

    Raises:
        DomainError: no seed, or one out of its range.
    """
    text = spec[len(PREFIX) :]
    try:
        seed = int(text)
    except ValueError:
        raise DomainError(f"{spec}: seed = {text!r} is not a whole number; write {PREFIX}7") from None
    return random_part(seed)


def fitted(rng: np.random.Generator, polygon: shapely.Geometry, name: str) -> Domain | None:
    """The domain of a polygon, with the vertices drawn or, where these cannot follow it, more; None beyond MOST."""
    if not isinstance(polygon, shapely.Polygon) or not polygon.is_valid:
        return None
    outlines = [fine(ring) for ring in (polygon.exterior, *polygon.interiors)]
    spacing = drawn_spacing(rng, outlines[0])
    vertices = FEWEST * (MOST / FEWEST) ** rng.random()
    while vertices <= MOST:
        rings = discretised(outlines, 2 * round(vertices / 2), spacing)
        if rings is not None and alike(rings, outlines) and smooth(rings) and roomy(rings):
            try:
                return from_rings(rings[0], rings[1:], name)
            except DomainError:
                return None
        vertices *= DENSER
    return None


def fine(ring: shapely.LinearRing) -> Floats:
    """A ring as a counter-clockwise polyline, (m, 2), much finer than the vertices wanted."""
    corners = shapely.get_coordinates(shapely.Polygon(ring).normalize().exterior)[:0:-1]
    corners = corners[np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1) > 1e-7]
    t = np.arange(16)[:, None] / 16
    return (corners[:, None] * (1.0 - t) + np.roll(corners, -1, axis=0)[:, None] * t).reshape(-1, 2)


def drawn_spacing(rng: np.random.Generator, outline: Floats) -> Spacing:
    """Even spacing, finer near one or two places of the outline, or a wave across it."""
    choice, ratio = rng.random(), rng.uniform(1.5, 3.0)
    if choice < 0.6:
        return even
    if choice < 0.85:
        return near(outline[rng.integers(len(outline), size=rng.integers(1, 3))].tolist(), rng.uniform(0.8, 1.6), ratio)
    return wave(ratio, rng.uniform(0.0, np.pi), rng.uniform(1.5, 4.0), rng.uniform(0.0, 2 * np.pi))


def alike(rings: list[Floats], outlines: list[Floats]) -> bool:
    """Whether the vertices enclose about the areas of their outlines."""
    return all(
        LIKENESS <= signed_area(ring) / signed_area(outline) <= 1 / LIKENESS
        for ring, outline in zip(rings, outlines, strict=True)
    )


def smooth(rings: list[Floats]) -> bool:
    """Whether no segment is far longer than its neighbour or than the shortest."""
    lengths = [np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1) for ring in rings]
    steps = max(np.abs(np.log(length / np.roll(length, 1))).max() for length in lengths)
    whole = np.concatenate(lengths)
    return bool(steps <= np.log(NEIGHBOURS) and whole.max() <= ALL * whole.min())
