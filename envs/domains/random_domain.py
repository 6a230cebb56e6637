"""Random domains: simple, even, from convex to spiky, with and without holes; one seed, one domain."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely

from envs.domains.endless import HELD_OUT, HELD_OUT_PREFIX, EndlessDomains
from envs.domains.outline_families import FAMILIES
from envs.polygons.outline import Spacing, corners, discretise, shares, wave
from envs.polygons.turning import signed_angles
from envs.polygons.validation import from_rings
from envs.types import Domain, DomainError, Floats

#: What names of random domains begin with: ``random-7``, ``random-7_spikiness=0.5_holes=1``, ``random-held-out-3``.
PREFIX = "random-"
#: What else asks for one: ``random:7?spikiness=0.5&holes=1``.
SPEC = "random:"
NAME = re.compile(r"random-(held-out-)?\d+(_[a-z]+=[^_]*)*", re.IGNORECASE)

#: Outlines tried before the plain disc that always works.
ATTEMPTS = 20

#: Least distance of a vertex from the boundary across, over the local segment length.
LEAST_CLEARANCE = 0.3

#: Least segment length over the mean one.
LEAST_SEGMENT = 0.25

#: Least angle between neighbouring segments, in radians.
LEAST_ANGLE = np.radians(15.0)

OUTER_LEAST, HOLE_LEAST = 12, 6


@dataclass(frozen=True)
class RandomDomains(EndlessDomains):
    """An endless supply of domains called ``random-SEED``."""

    name: str = "random"
    vertices: int = 256
    elements: int = 16_384

    def domain(self, seed: int) -> Domain:
        """See `random_domain`."""
        return random_domain(seed)


@dataclass(frozen=True)
class Wishes:
    """What a random domain shall be like.

    Attributes:
        vertices: given boundary vertices in all, even, at least 12 and 6 more for each hole.
        spikiness: 0 (convex or smooth) to 1 (sharp).
        holes: 0 to 8.
        unevenness: ratio of the largest to the smallest wanted spacing, 1 to 4.
    """

    vertices: int
    spikiness: float
    holes: int
    unevenness: float


def random_domain(
    seed: int,
    *,
    vertices: int | None = None,
    spikiness: float | None = None,
    holes: int | None = None,
    unevenness: float | None = None,
) -> Domain:
    """The domain of a seed; what is None is drawn from the seed too.

    Args:
        seed: 0 to 2**63 - 1.
        vertices: even, at least 12 + 6 * holes, at most 5000; drawn from 24 to 200.
        spikiness: 0 (convex or smooth) to 1 (sharp); drawn from all of it.
        holes: 0 to 8; drawn from 0 to 3, mostly 0.
        unevenness: ratio of the largest to the smallest wanted spacing, 1 to 4; drawn from 1 to 3.

    Raises:
        DomainError: a parameter out of its range.
    """
    name = spec_of(seed, vertices=vertices, spikiness=spikiness, holes=holes, unevenness=unevenness)
    check(name, seed, vertices, spikiness, holes, unevenness)
    rng = np.random.default_rng(seed)
    wishes = drawn(rng, vertices, spikiness, holes, unevenness)
    for _ in range(ATTEMPTS):
        domain = attempt(rng, wishes, name)
        if domain is not None:
            return domain
    return plain(wishes, name)


def spec_of(seed: int, **given: float | None) -> str:
    """The name that :func:`from_spec` reads back as the same domain, and that every system takes as a file's name."""
    number = seed if seed < HELD_OUT else f"{HELD_OUT_PREFIX}{seed - HELD_OUT}"
    return "_".join([f"{PREFIX}{number}", *(f"{key}={value!r}" for key, value in given.items() if value is not None)])


def is_spec(text: str) -> bool:
    """Whether a text asks for a random domain."""
    return text.lower().startswith(SPEC) or NAME.fullmatch(text) is not None


def from_spec(spec: str) -> Domain:
    """The domain of ``random-SEED``, ``random-SEED_key=value_...``, ``random:SEED`` or ``random:SEED?key=value&...``.

    ``held-out-I`` is the seed of the I-th domain that is kept from training.

    Raises:
        DomainError: no seed, an unknown key, or a value that is no number or out of its range.
    """
    parameters: dict[str, Callable[[str], float]] = {
        "vertices": int,
        "spikiness": float,
        "holes": int,
        "unevenness": float,
    }
    head, *pairs = re.split("[?&_]", spec[len(PREFIX) :].lower())
    first = HELD_OUT if head.startswith(HELD_OUT_PREFIX) else 0
    given: dict[str, float] = {}
    for pair in filter(None, pairs):
        key, _, value = pair.partition("=")
        if key not in parameters:
            raise DomainError(f"{spec}: unknown parameter {key!r}; use {', '.join(parameters)}")
        given[key] = number(spec, key, value, parameters[key])
    seed = int(number(spec, "seed", head.removeprefix(HELD_OUT_PREFIX), int))
    return random_domain(first + seed, **given)  # type: ignore[arg-type]


def number(spec: str, key: str, value: str, as_number: Callable[[str], float]) -> float:
    """A number out of a spec."""
    try:
        return as_number(value)
    except ValueError:
        what = "a whole number" if as_number is int else "a number"
        raise DomainError(
            f"{spec}: {key} = {value!r} is not {what}; write random-7_vertices=80_spikiness=0.5"
        ) from None


def check(
    name: str, seed: int, vertices: int | None, spikiness: float | None, holes: int | None, unevenness: float | None
) -> None:
    """Refuse what is out of range."""
    least = OUTER_LEAST + HOLE_LEAST * (holes or 0)
    ranges = {
        "seed": (seed, 0, 2**63 - 1), "vertices": (vertices, least, 5000), "spikiness": (spikiness, 0, 1),
        "holes": (holes, 0, 8), "unevenness": (unevenness, 1, 4),
    }  # fmt: skip
    for key, (value, low, high) in ranges.items():
        if value is not None and not low <= value <= high:
            raise DomainError(f"{name}: {key} = {value!r} is out of range; choose it from {low} to {high}")
    if vertices is not None and vertices % 2:
        raise DomainError(f"{name}: vertices = {vertices} is odd; choose an even number")


def drawn(
    rng: np.random.Generator, vertices: int | None, spikiness: float | None, holes: int | None, unevenness: float | None
) -> Wishes:
    """The wishes, those that are None drawn; the same numbers are drawn whatever is given."""
    size, sharp, hollow, ratio = rng.random(4)
    # Small domains are as frequent as large ones: the size is drawn on a logarithmic scale.
    total = 2 * round(0.5 * 24 * (200 / 24) ** size) if vertices is None else vertices
    room = (total - OUTER_LEAST) // HOLE_LEAST
    count = min(int(np.searchsorted([0.72, 0.88, 0.96], hollow)), room) if holes is None else holes
    return Wishes(
        vertices=max(total, OUTER_LEAST + HOLE_LEAST * count) if vertices is None else total,
        spikiness=float(sharp) if spikiness is None else spikiness,
        holes=count,
        unevenness=float(1.0 + 2.0 * ratio) if unevenness is None else unevenness,
    )


def attempt(rng: np.random.Generator, wishes: Wishes, name: str) -> Domain | None:
    """Random outlines as a domain, or None when it does not give a good domain."""
    family = FAMILIES[rng.integers(len(FAMILIES))]
    outer = family(rng, wishes.spikiness, max(2, wishes.vertices // 10))
    outer = turned(outer, rng.uniform(0.0, 2 * np.pi))
    inner = random_holes(rng, outer, wishes)
    spacing = wave(wishes.unevenness, rng.uniform(0.0, np.pi), rng.uniform(1.5, 4.0), rng.uniform(0.0, 2 * np.pi))
    if inner is None:
        return None
    rings = discretised([outer, *inner], wishes.vertices, spacing)
    if rings is None or not roomy(rings):
        return None
    try:
        return from_rings(rings[0], rings[1:], name)
    except DomainError:
        return None


def turned(outline: Floats, angle: float) -> Floats:
    """The (m, 2) outline rotated by an angle in radians."""
    c, s = np.cos(angle), np.sin(angle)
    return outline @ np.array([[c, s], [-s, c]])


def random_holes(rng: np.random.Generator, outer: Floats, wishes: Wishes) -> list[Floats] | None:
    """Outlines of holes well apart from each other and from the outer one; None when they find no room."""
    # A rough copy is enough to find room in, and ten times as fast.
    free = shapely.Polygon(outer).simplify(0.003)
    if not free.is_valid:
        return None
    found: list[Floats] = []
    low, high = outer.min(axis=0), outer.max(axis=0)
    for _ in range(wishes.holes):
        centres = rng.uniform(low, high, (200, 2))
        points = shapely.points(centres)
        room = np.where(shapely.contains(free, points), shapely.distance(free.boundary, points), 0.0)
        best = int(np.argmax(room * rng.uniform(0.5, 1.0, len(room))))
        if room[best] < 0.05:
            return None
        hole = centres[best] + room[best] * rng.uniform(0.3, 0.5) * hole_outline(rng, wishes.spikiness)
        found.append(hole)
        free = free.difference(shapely.Polygon(hole))
    return found


def hole_outline(rng: np.random.Generator, spikiness: float) -> Floats:
    """A hole's outline within the unit disc: a round one or a polygon of 3 to 6 corners."""
    sides = int(rng.integers(3, 7)) if rng.random() < 0.3 + 0.4 * spikiness else 180
    angles = 2 * np.pi * (np.arange(sides) + rng.random()) / sides
    ring = np.stack([np.cos(angles), rng.uniform(0.6, 1.0) * np.sin(angles)], axis=1)
    t = np.arange(24)[:, None] / 24
    return (ring[:, None] * (1.0 - t) + np.roll(ring, -1, axis=0)[:, None] * t).reshape(-1, 2)


def discretised(outlines: list[Floats], vertices: int, spacing: Spacing) -> list[Floats] | None:
    """Rings of all outlines, shared out by length over spacing; None when the corners alone are too many."""
    weights = [float((np.linalg.norm(np.roll(o, -1, axis=0) - o, axis=1) / spacing(o)).sum()) for o in outlines]
    least = np.array([OUTER_LEAST, *[HOLE_LEAST] * (len(outlines) - 1)]) - 1
    counts = least + shares(
        np.maximum(np.array(weights) / sum(weights) * vertices - least, 1e-3), vertices - least.sum()
    )
    if any(len(corners(o)) > c for o, c in zip(outlines, counts, strict=True)):
        return None
    return [discretise(o, int(c), spacing) for o, c in zip(outlines, counts, strict=True)]


def roomy(rings: list[Floats]) -> bool:
    """Whether no segment is far too short, no corner too sharp and no passage, inside or outside, too narrow.

    Clearance is the distance of a vertex from the segments beyond its neighbours, over its own segments' mean length.
    """
    here = np.concatenate(rings)
    ahead = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    behind = np.concatenate([np.roll(ring, 1, axis=0) for ring in rings])
    forth, back = ahead - here, behind - here
    angle = np.abs(signed_angles(forth, back))
    lengths = np.linalg.norm(forth, axis=1)
    if angle.min() < LEAST_ANGLE or lengths.min() < LEAST_SEGMENT * lengths.mean():
        return False
    local = 0.5 * (lengths + np.linalg.norm(back, axis=1))
    segments = shapely.linestrings(np.stack([here, ahead], axis=1))
    i, j = shapely.STRtree(segments).query(shapely.points(here), predicate="dwithin", distance=LEAST_CLEARANCE * local)
    return all(nearby(rings, a, b) for a, b in zip(i.tolist(), j.tolist(), strict=True))


def nearby(rings: list[Floats], vertex: int, segment: int) -> bool:
    """Whether a segment is one of the four nearest to a vertex along the same ring."""
    start = 0
    for ring in rings:
        if start <= vertex < start + len(ring):
            return start <= segment < start + len(ring) and (segment - vertex + 2) % len(ring) < 4
        start += len(ring)
    return False


def plain(wishes: Wishes, name: str) -> Domain:
    """A disc with round holes on a circle: what remains when no outline drawn had room for the wishes."""
    angles = 2 * np.pi * np.arange(wishes.holes) / max(1, wishes.holes)
    hole = 0.15 * circle(HOLE_LEAST)
    holes = [hole + 0.55 * np.array([np.cos(a), np.sin(a)]) for a in angles]
    return from_rings(circle(wishes.vertices - HOLE_LEAST * wishes.holes), holes, name)


def circle(n: int) -> Floats:
    """n vertices on the unit circle, (n, 2)."""
    angles = 2 * np.pi * np.arange(n) / n
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)
