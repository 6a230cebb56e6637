"""The front door: a catalogue name, a seed, a polygon file or a Python object becomes a :class:`Domain`."""

from __future__ import annotations

import difflib
import os
from pathlib import Path
from typing import Any

import numpy as np

from envs.domains import random_domain, random_part, varied_domain
from envs.domains.endless import EndlessDomains
from envs.domains.random_domain import RandomDomains
from envs.domains.user_domains import UserDomains
from envs.domains.varied_domain import VariedDomains
from envs.plug_in import is_spec
from envs.polygons.domain import domains_of, from_polygon, from_ring_with_seam, from_rings, largest_wanted, wanted_at
from envs.polygons.size_cells import Size
from envs.polygons.sizing import CURVATURE
from envs.readers.formats import BY_SUFFIX
from envs.readers.python_objects import polygons_of
from envs.readers.read import Polygons, read
from envs.readers.source import check_file
from envs.types import Domain, DomainError, Floats, WantedSizes

__all__ = [
    "RandomDomains",
    "Source",
    "UserDomains",
    "VariedDomains",
    "catalogue",
    "from_object",
    "from_polygon",
    "from_ring_with_seam",
    "from_rings",
    "load",
    "load_all",
    "source",
]

#: What episodes can be on.
Source = Domain | EndlessDomains | UserDomains

#: The endless supplies that have a name.
SUPPLIES: tuple[EndlessDomains, ...] = (RandomDomains(), VariedDomains())

#: Where the catalogue's data and drawings lie.
CATALOGUE = Path(__file__).parent / "catalogue"


def catalogue() -> list[str]:
    """Names of the built-in domains: the training domains T1.. last, the test domains D1.. first, in order."""
    return sorted((path.stem for path in CATALOGUE.glob("*.json")), key=lambda name: (name[0], len(name), name))


def source(spec: str) -> Source:
    """What episodes can be on: ``random`` and ``varied`` are endless supplies, ``package.module:Name`` is one of a
    user's (unless a file is called so), anything else a domain as :func:`load` finds it.
    """
    if is_spec(spec) and not os.path.isfile(spec):
        return UserDomains(spec)
    named = {supply.name: supply for supply in SUPPLIES}.get(spec.lower())
    return load(spec) if named is None else named


def load(
    spec: str | os.PathLike[str],
    *,
    fix_parity: bool = False,
    edge_length: float | None = None,
    grading: float = 1.0,
    curvature: float = CURVATURE,
    size: Size | Floats | None = None,
    allow_large: bool = False,
) -> Domain:
    """The one domain that ``spec`` names; see :func:`load_all`.

    Raises:
        DomainError: as :func:`load_all`, or another number of polygons than one.
    """
    polygons, name, source = given(spec, np.inf if edge_length is None and size is not None else edge_length)
    if len(polygons) != 1:
        fix = "keep one in each file" if polygons else "give one"
        raise DomainError(f"{source}: {len(polygons)} polygons where exactly one is needed; {fix}")
    return domains_of(
        polygons, name, source, fix_parity=fix_parity, edge_length=edge_length, grading=grading, curvature=curvature,
        size=size, allow_large=allow_large,
    )[0]  # fmt: skip


def load_all(
    spec: str | os.PathLike[str],
    *,
    fix_parity: bool = False,
    edge_length: float | None = None,
    grading: float = 1.0,
    curvature: float = CURVATURE,
    size: Size | Floats | None = None,
    allow_large: bool = False,
) -> list[Domain]:
    """Every domain that ``spec`` names.

    Several polygons of one file are domains of their own, called ``part[0]``, ``part[1]``, ... after the file
    ``part``. Where they share boundary segments, what is set on these is the same for both, number for number.

    Args:
        spec: a catalogue name in any case (``T1``), a seed (``random-7``, ``random-7_spikiness=0.5_holes=1``,
            ``part-7``, ``varied-7``), or the path of a polygon file (the extensions are those of
            :mod:`envs.readers.formats`).
        fix_parity: split the longest segment at its midpoint when a polygon's number of vertices is odd.
        edge_length: discretise the outline: every corner stays, a side of length l gets round(l / edge_length) >= 1
            equal segments, a fine and smooth stretch is resampled along itself; every total is then even.
        grading: largest segment over the smallest, 1 (even) to 1000: above 1 segments shrink from ``edge_length``
            near short sides, sharp and re-entrant corners and in narrow places, and grow again smoothly.
        curvature: segments for a full turn of an arc, 4 to 180, where the outline is discretised: arcs of drawings, and
            those that fine vertices follow.
        size: discretise the outline by this size, and by ``edge_length`` where that is less: a function of (m, 2)
            places to (m,) edge lengths, asked inside the polygons alone, or (m, 3) rows x, y and an edge length, from
            which sizes grow.
        allow_large: also where ``edge_length`` asks for a mesh of more than 2 million elements.

    Raises:
        DomainError: the source, the place and the fix in one line.
    """
    polygons, name, source = given(spec, np.inf if edge_length is None and size is not None else edge_length)
    if not polygons:
        raise DomainError(f"{source}: no polygon in it; give at least one")
    return domains_of(
        polygons, name, source, fix_parity=fix_parity, edge_length=edge_length, grading=grading, curvature=curvature,
        size=size, allow_large=allow_large,
    )  # fmt: skip


def from_object(
    polygon: Any,
    name: str = "polygon",
    *,
    fix_parity: bool = False,
    edge_length: float | None = None,
    grading: float = 1.0,
    curvature: float = CURVATURE,
    size: Size | Floats | None = None,
    allow_large: bool = False,
) -> list[Domain]:
    """The domains of a polygon that a program holds, one for each polygon in it.

    Args:
        polygon: an (n, 2) array or a list of pairs (one ring, which may walk seams to its holes); a list of rings, the
            outer one first; a list of such lists; a shapely Polygon, MultiPolygon or LinearRing, or a list of them; a
            GeoJSON-like mapping or anything with ``__geo_interface__``; a mapping with ``rings``.
        name: the domain's name; several are called ``name[0]``, ``name[1]``, ...
        fix_parity: as for :func:`load_all`.
        edge_length: as for :func:`load_all`.
        grading, curvature, size: as for :func:`load_all`.
        allow_large: as for :func:`load_all`.

    Raises:
        DomainError: an object that holds no polygon, or one that cannot be meshed.
    """
    polygons = polygons_of(polygon, name)
    if not polygons:
        raise DomainError(f"{name}: no polygon in it; give at least one")
    return domains_of(
        polygons, name, name, fix_parity=fix_parity, edge_length=edge_length, grading=grading, curvature=curvature,
        size=size, allow_large=allow_large,
    )  # fmt: skip


def given(spec: str | os.PathLike[str], edge_length: float | None) -> tuple[Polygons, str, str]:
    """The polygons that ``spec`` names as lists of rings, their name, and what messages call the source."""
    text = os.fspath(spec)
    path = Path(text)
    if isinstance(spec, str):
        for random in (random_domain, random_part, varied_domain):
            if random.is_spec(text) and not os.path.isfile(text):
                drawn = random.from_spec(text)
                return [rings_of(drawn)], drawn.name, text
        if text.upper() in catalogue():
            path = CATALOGUE / f"{text.upper()}.json"
        elif not looks_like_path(text):
            raise DomainError(unknown_name(text))
    return read(path, edge_length), path.stem, str(path)


def own_sizes(spec: str | os.PathLike[str]) -> Floats | None:
    """The sizes that a polygon file states itself, (m, 3) rows x, y and an edge length: those of a ``.geo``'s points.

    Raises:
        DomainError: as :func:`load_all`.
    """
    path = Path(spec)
    if BY_SUFFIX.get(path.suffix.lower()) is not BY_SUFFIX[".geo"]:
        return None
    from envs.readers import geo

    check_file(path, BY_SUFFIX[".geo"].most_bytes)
    return geo.sizes_of_file(path)


def wanted_sizes(
    domain: Domain,
    size: Size | Floats | None,
    *,
    edge_length: float | None = None,
    least: float = 0.0,
    most: float = np.inf,
) -> WantedSizes:
    """What the inside of a domain is to keep to, of what its boundary was split by.

    Args:
        domain: split by the size.
        size, edge_length: as :func:`load_all` was given them.
        least, most: bounds of the size inside; by default as far up as the size and the edge length say.

    Raises:
        UserError: sizes that are none.
    """
    if size is None:
        return WantedSizes(least, most)
    points = wanted_at(size, [rings_of(domain)])
    largest = max(least, largest_wanted(size, points, edge_length))
    ends = domain.points[domain.segments]
    if most == np.inf and largest > np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max():
        most = largest
    return WantedSizes(least, most, points)


def rings_of(domain: Domain) -> list[Floats]:
    """The rings that a domain was made of: its points come ring by ring, its segments with them."""
    ahead = domain.segments[:, 1]
    ends = np.flatnonzero(ahead != domain.segments[:, 0] + 1) + 1
    return np.split(domain.points[: len(ahead)], ends[:-1])


def looks_like_path(text: str) -> bool:
    """Whether a text can only be meant as a file: it exists, has folders or ends like a file."""
    path = Path(text)
    return os.sep in text or "/" in text or path.suffix != "" or (text != "" and os.path.isfile(path))


def unknown_name(text: str) -> str:
    """The line for a name that is in no catalogue, with the nearest one."""
    names = catalogue()
    near = difflib.get_close_matches(text.upper(), names, n=1, cutoff=0.3)
    meant = f"did you mean {near[0]}? " if near else ""
    return (
        f"{text!r}: no domain of this name; {meant}The catalogue has {', '.join(names)}; random-SEED draws one, and a "
        f"file ends in {', '.join(BY_SUFFIX)}"
    )
