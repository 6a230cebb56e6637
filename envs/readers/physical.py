"""Names from physical groups: what is in several takes the first group's, and a note says so."""

from __future__ import annotations

from collections.abc import Iterable


def names_of(kind: str, groups: Iterable[tuple[int, str, Iterable[int]]]) -> tuple[dict[int, str], list[str]]:
    """The name of each member of physical groups.

    Args:
        kind: what the members are: ``curve``, ``surface`` or ``point``; also the name of groups that have a number
            alone, as ``curve_7``.
        groups: the number, the name, which may be empty, and the members' tags of each, with any signs.

    Returns:
        Names by tag, and notes, a line each.
    """
    names: dict[int, str] = {}
    twice: dict[int, str] = {}
    for number, name, members in groups:
        called = name or f"{kind}_{number}"
        for tag in members:
            first = names.setdefault(abs(tag), called)
            if first != called:
                twice.setdefault(abs(tag), called)
    if not twice:
        return names, []
    tag, other = next(iter(twice.items()))
    more = f" (so are {len(twice) - 1} more)" if len(twice) > 1 else ""
    return names, [f"{kind} {tag} is in the physical groups {names[tag]!r} and {other!r}{more}; the first names it"]
