"""The front door of the domains: a catalogue name, a random seed or a polygon file becomes a :class:`Domain`."""

from __future__ import annotations

import difflib
import os
from pathlib import Path

from envs import random_domain as generator
from envs import random_part
from envs.polygon import from_polygon, from_ring_with_seam, from_rings
from envs.random_domain import RandomDomains
from envs.readers import READERS, read
from envs.types import Domain, DomainError

__all__ = ["RandomDomains", "catalogue", "from_polygon", "from_ring_with_seam", "from_rings", "load", "source"]

#: Where the catalogue's data and drawings lie.
CATALOGUE = Path(__file__).parent / "domains"


def catalogue() -> list[str]:
    """Names of the built-in domains: the training domains T1.. last, the test domains D1.. first, in order."""
    return sorted((path.stem for path in CATALOGUE.glob("*.json")), key=lambda name: (name[0], len(name), name))


def source(spec: str) -> Domain | RandomDomains:
    """What episodes can be on: ``random`` is the endless supply, anything else a domain as :func:`load` finds it."""
    return RandomDomains() if spec.lower() == RandomDomains.name else load(spec)


def load(spec: str | os.PathLike[str], *, fix_parity: bool = False) -> Domain:
    """The domain that ``spec`` names.

    Args:
        spec: a catalogue name in any case (``T1``), a seed (``random:7``, ``random:7?spikiness=0.5&holes=1``,
            ``part:7``), or the path of a polygon file (``.geojson``, ``.json``, ``.wkt``, ``.txt``).
        fix_parity: split the longest segment at its midpoint when the number of vertices is odd.

    Raises:
        DomainError: the source, the place and the fix in one line.
    """
    text = os.fspath(spec)
    if isinstance(spec, str):
        if text.lower().startswith(generator.PREFIX):
            return generator.from_spec(text)
        if text.lower().startswith(random_part.PREFIX):
            return random_part.from_spec(text)
        if text.upper() in catalogue():
            return read(CATALOGUE / f"{text.upper()}.json", fix_parity=fix_parity)
        if not looks_like_path(text):
            raise DomainError(unknown_name(text))
    return read(text, fix_parity=fix_parity)


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
        f"{text!r}: no domain of this name; {meant}The catalogue has {', '.join(names)}; random:SEED draws one, and a "
        f"file ends in {', '.join(READERS)}"
    )
