"""What was found among the pieces of a drawing as polygons and lines, with the names that its entities have."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from envs.polygons.drawing import Drawing, Line
from envs.readers.joins import option
from envs.readers.nesting import nested
from envs.readers.outline_search import Face, Outlines
from envs.types import DomainError, Floats


class OpenOutlineError(DomainError):
    """An outline that does not close.

    Attributes:
        lines: what was drawn, each (k, 2) float64.
        gaps: (g, 2, 2) float64, the ends that nearly meet; or an open end, twice.
    """

    def __init__(self, message: str, lines: Sequence[Floats], gaps: Floats) -> None:
        super().__init__(message)
        self.lines, self.gaps = lines, gaps


def drawn(found: Outlines, names: Sequence[str], notes: Sequence[str], source: str) -> Drawing:
    """The drawing of what was found.

    Names are those of sides. Only where several regions have outer rings of several names, each of one name alone,
    they are those of regions, and of no side.

    Args:
        found: the outlines.
        names: of the entities, by number; empty: none.
        notes: for the user; empty ones are left out.
        source: the name that messages begin with.

    Raises:
        DomainError: rings in each other, or too many.
    """
    every = {id(face.rings[0]): face for group in found.groups for face in group}
    polygons = nested([[face.rings for face in group] for group in found.groups], source)
    given = [name_of(every[id(rings[0])], names) for rings in polygons]
    several = len({name for name in given if name is not None}) > 1
    regions = tuple(name or "" if several else "" for name in given)
    # Where two lie on one side the first one's name counts.
    silent = frozenset(regions) | {""}
    lines = [*optional_lines(found, names, silent), *side_lines(found, names, silent)]
    told = [joined_note(found), *notes]
    return Drawing(polygons, regions if any(regions) else (), lines, notes=[note for note in told if note])


def name_of(face: Face, names: Sequence[str]) -> str | None:
    """The name that all of a face's outer ring was drawn with; None: there is none."""
    common = set.intersection(*({names[i] for i in side.entities} for side in face.around))
    return min(common, key=lambda name: (not name, name)) if common else None


def side_lines(found: Outlines, names: Sequence[str], silent: frozenset[str]) -> Iterator[Line]:
    """The sides that have a name other than the silent ones, or a curve."""
    for side in found.sides:
        name = names[side.piece.entity]
        name = "" if name in silent else name
        if name or side.piece.curve is not None:
            yield Line(side.points, name=name, curve=side.piece.curve)


def optional_lines(found: Outlines, names: Sequence[str], silent: frozenset[str]) -> Iterator[Line]:
    """What was drawn upon a side, and what bounds nothing, by names that are not silent: it names what lies on it."""
    for piece in (*found.beside, *found.left):
        if names[piece.entity] not in silent:
            yield Line(piece.fine, name=names[piece.entity], curve=piece.curve, optional=True)


def joined_note(found: Outlines) -> str:
    """What was joined."""
    if not found.joined:
        return ""
    return f"joined {counted(len(found.joined), 'gap')} of up to {max(found.joined):.3g}"


def gap_note(found: Outlines) -> str:
    """What would close a line that was passed over; empty when nothing nearly does."""
    if not found.gaps:
        return ""
    gap = found.gaps[0]
    a, b = gap.told
    return f"; ends at {a} and {b} are {gap.width:.3g} apart, {option(gap.width)} joins them"


def counted(number: int, kind: str) -> str:
    """A number of things; what is in capitals has no plural."""
    return f"{number} {kind}" if number == 1 or kind.isupper() else f"{number} {kind}s"


def check_closed(found: Outlines, fix: str, source: str) -> None:
    """Refuse a drawing of which nothing closes, or an outline of it that nearly does.

    Args:
        found: the outlines.
        fix: what else than joining helps.
        source: the name that messages begin with.

    Raises:
        DomainError: the gap with its places, and the option that joins it.
    """
    gap = found.slip if found.groups else next(iter(found.gaps), None)
    lines = [*(side.points for side in found.sides), *(piece.fine for piece in (*found.beside, *found.left))]
    if gap is not None:
        a, b = gap.told
        raise OpenOutlineError(
            f"{source}: a curve ends at {a} and no other begins there, the nearest open end is {gap.width:.3g} away at "
            f"{b}; join them with {option(gap.width)}, or {fix}",
            lines,
            np.array([one.ends for one in found.gaps]),
        )
    if not found.groups:
        where = f"a curve ends at {found.tip} and no other begins there" if found.tip else "no curve encloses anything"
        ends = np.array([[piece.ends[1]] * 2 for piece in found.left[:1]]).reshape(-1, 2, 2)
        raise OpenOutlineError(f"{source}: {where}; close the outline", lines, ends)
