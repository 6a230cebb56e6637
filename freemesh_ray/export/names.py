"""Names of parts as a format can hold them: changed where they must be, and never two made one."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection
from dataclasses import dataclass, replace

from freemesh_ray.export.finite_elements import FiniteElements

#: What a name is called that has no letter a format can hold.
NAMELESS = "unnamed"


@dataclass(frozen=True)
class NameRule:
    """What names a format can hold.

    Attributes:
        most: characters at most.
        allowed: a regular expression's class of characters; others become ``_``, letters with accents lose them.
        letter_first: whether the first one is a letter; ``n_`` comes before another.
        capitals: whether names are written in capitals, because the format makes no difference.
        reserved: names that mean something else there.
    """

    most: int
    allowed: str = "A-Za-z0-9_.+-"
    letter_first: bool = False
    capitals: bool = False
    reserved: frozenset[str] = frozenset()

    def held(self, name: str) -> str:
        """The name as the format can hold it; two of them may come out alike."""
        unknown = re.compile(f"[^{self.allowed}]+")
        text = name.strip()
        if unknown.search(text):
            bare = (c for c in unicodedata.normalize("NFKD", text) if not unicodedata.combining(c))
            text = unknown.sub("_", "".join(bare).strip())
        if not any(c.isalnum() for c in text):
            text = NAMELESS
        if self.letter_first and not text[0].isalpha():
            text = f"n_{text.lstrip('_')}"
        return (text.upper() if self.capitals else text)[: self.most].strip()


def free(name: str, taken: Collection[str], most: int | None = None) -> str:
    """The name, with a number where it is taken; of ``most`` characters at most."""
    i, found = 2, name
    while found in taken:
        end = f"_{i}"
        found, i = f"{name[: None if most is None else most - len(end)]}{end}", i + 1
    return found


@dataclass(frozen=True)
class Change:
    """A part of one of the kinds ``sides``, ``regions``, ``lines`` and ``points``, its name, and that in the file."""

    kind: str
    old: str
    new: str


def renamed(mesh: FiniteElements, rule: NameRule) -> tuple[FiniteElements, list[Change]]:
    """The mesh with names that a format can hold, no two alike in any kind of part; and what was changed.

    Names that are as they can be stay as they are, whatever others become. Capitals alone are no change.
    """
    kinds = ("sides", "regions", "lines", "points")
    names = [(kind, part.name) for kind in kinds for part in getattr(mesh, kind)]
    new: dict[tuple[str, str], str] = {}
    taken: set[str] = set(rule.reserved)

    def folded(name: str) -> str:
        return name.upper() if rule.capitals else name

    for as_it_is in (True, False):
        for key in names:
            held = rule.held(key[1])
            if key in new or (as_it_is and (held != folded(key[1]) or held in taken)):
                continue
            new[key] = free(held, taken, rule.most)
            taken.add(new[key])
    changes = [Change(kind, old, new[kind, old]) for kind, old in names if new[kind, old] != folded(old)]
    changed = replace(
        mesh,
        sides=tuple(replace(part, name=new["sides", part.name]) for part in mesh.sides),
        lines=tuple(replace(part, name=new["lines", part.name]) for part in mesh.lines),
        regions=tuple(replace(part, name=new["regions", part.name]) for part in mesh.regions),
        points=tuple(replace(part, name=new["points", part.name]) for part in mesh.points),
    )
    return changed, changes
