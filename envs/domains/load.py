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
from envs.plug_ins.lookup import is_spec
from envs.polygons.drawing import Drawing, Reading
from envs.polygons.geometry import Geometry
from envs.polygons.size_cells import Size
from envs.polygons.sound import LeftOut, sound_geometry
from envs.polygons.validation import (
    from_polygon,
    from_ring_with_seam,
    from_rings,
    geometry_of,
    largest_wanted,
    wanted_at,
)
from envs.readers.file_check import check_file
from envs.readers.formats import BY_SUFFIX
from envs.readers.python_objects import drawing_of
from envs.readers.read import read
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

#: What is drawn by a seed.
SEEDED = (random_domain, random_part, varied_domain)

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


def load(spec: str | os.PathLike[str], **options: Any) -> Domain:
    """The one domain that ``spec`` names; see :func:`load_all`.

    Raises:
        DomainError: as :func:`load_all`, or another number of polygons than one.
    """
    found = load_geometry(spec, most=1, **options)
    return found.regions[0].domain


def load_all(spec: str | os.PathLike[str], **options: Any) -> list[Domain]:
    """Every domain that ``spec`` names: the regions of :func:`load_geometry`, whose arguments it takes."""
    return [region.domain for region in load_geometry(spec, **options).regions]


def load_geometry(
    spec: str | os.PathLike[str],
    *,
    layers: tuple[str, ...] = (),
    join: float | None = None,
    edge_length: float | None = None,
    size: Size | Floats | None = None,
    most: int | None = None,
    left_out: LeftOut | None = None,
    **options: Any,
) -> Geometry:
    """What ``spec`` names, its boundary split.

    Several polygons of one file are regions, whose domains are called ``part[0]``, ``part[1]``, ... after the file
    ``part``. Where they share boundary segments, what is set on these is the same for both, number for number.

    Args:
        spec: a catalogue name in any case (``T1``), a seed (``random-7``, ``random-7_spikiness=0.5_holes=1``,
            ``part-7``, ``varied-7``), or the path of a polygon file (the extensions are those of
            :mod:`envs.readers.formats`).
        layers, join: how a drawing is read, see :class:`envs.polygons.drawing.Reading`.
        edge_length: discretise the outline: every corner stays, a side of length l gets round(l / edge_length) >= 1
            equal segments, a fine and smooth stretch is resampled along itself; every total is then even.
        size: discretise the outline by this size, and by ``edge_length`` where that is less: a function of (m, 2)
            places to (m,) edge lengths, asked inside the polygons alone, or (m, 3) rows x, y and an edge length, from
            which sizes grow.
        most: polygons at most; None: as many as there are.
        left_out: leave polygons out that cannot be meshed, where there are several, and call this with each; see
            :func:`envs.polygons.sound.sound_geometry`.
        options: ``fix_parity``, ``grading``, ``curvature``, ``allow_large``, ``room``, ``odd``: see
            :func:`envs.polygons.validation.geometry_of`.

    Raises:
        DomainError: the source, the place and the fix in one line.
    """
    reading = Reading(np.inf if edge_length is None and size is not None else edge_length, layers, join)
    drawing, name, source = given(spec, reading)
    count = len(drawing.polygons)
    if not count:
        raise DomainError(f"{source}: no polygon in it; give at least one")
    if most is not None and count > most:
        raise DomainError(f"{source}: {count} polygons where exactly one is needed; keep one in each file")
    if left_out is not None:
        return sound_geometry(drawing, name, source, left_out, edge_length=edge_length, size=size, **options)
    return geometry_of(drawing, name, source, edge_length=edge_length, size=size, **options)


def from_object(polygon: Any, name: str = "polygon", **options: Any) -> list[Domain]:
    """The domains of a polygon that a program holds, one for each polygon in it; see :func:`object_geometry`."""
    return [region.domain for region in object_geometry(polygon, name, **options).regions]


def object_geometry(polygon: Any, name: str = "polygon", **options: Any) -> Geometry:
    """What a program holds, its boundary split.

    Args:
        polygon: an (n, 2) array or a list of pairs (one ring, which may walk seams to its holes); a list of rings, the
            outer one first; a list of such lists; a shapely Polygon, MultiPolygon or LinearRing, or a list of them; a
            GeoJSON-like mapping or anything with ``__geo_interface__``; a mapping with ``rings``; a
            :class:`envs.polygons.drawing.Drawing`.
        name: the domain's name; several are called ``name[0]``, ``name[1]``, ...
        options: ``fix_parity``, ``edge_length``, ``grading``, ``curvature``, ``size``, ``allow_large``, ``room``,
            ``odd``: see :func:`envs.polygons.validation.geometry_of`.

    Raises:
        DomainError: an object that holds no polygon, or one that cannot be meshed.
    """
    drawing = drawing_of(polygon, name)
    if not drawing.polygons:
        raise DomainError(f"{name}: no polygon in it; give at least one")
    return geometry_of(drawing, name, name, **options)


def given(spec: str | os.PathLike[str], reading: Reading) -> tuple[Drawing, str, str]:
    """The drawing that ``spec`` names, its name, and what messages call the source."""
    text = os.fspath(spec)
    path = Path(text)
    if isinstance(spec, str):
        for random in SEEDED:
            if random.is_spec(text) and not os.path.isfile(text):
                drawn = random.from_spec(text)
                return Drawing([rings_of(drawn)]), drawn.name, text
        if text.upper() in catalogue():
            path = CATALOGUE / f"{text.upper()}.json"
        elif not looks_like_path(text):
            raise DomainError(unknown_name(text))
    return read(path, reading), path.stem, str(path)


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


def check_known(spec: str) -> None:
    """Refuse what names nothing, without reading what it names.

    Raises:
        DomainError: neither a name of the catalogue, nor a seed, nor a file.
    """
    if not looks_like_path(spec):
        if spec.upper() not in catalogue() and not any(one.is_spec(spec) for one in SEEDED):
            raise DomainError(unknown_name(spec))
    elif not os.path.lexists(spec):
        raise DomainError(f"{spec}: no such file; check the path")


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
