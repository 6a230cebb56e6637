"""What ``--keep-going`` leaves out of a file with several polygons: told as it happens, and counted at the end."""

from __future__ import annotations

import re

from envs.errors import UserError
from freemesh_ray.formatting.terminal import note

#: The number at the end of a domain's name: ``part[7]``.
NUMBER = re.compile(r"\[(\d+)\]$")

#: Numbers that the last line lists at most.
LISTED = 20


class LeftOut:
    """Polygons, lines and points that are not in a mesh.

    Args:
        source: what the last line begins with.
    """

    def __init__(self, source: str) -> None:
        self._source = source
        self._polygons: list[str] = []
        self._others = 0

    def __bool__(self) -> bool:
        return bool(self._polygons) or self._others > 0

    def polygon(self, number: int | None, why: str) -> None:
        """Tell of a polygon that cannot be read, by its number, or of a line or a point beside it."""
        note(f"left out: {why}")
        if number is None:
            self._others += 1
        else:
            self._polygons.append(str(number))

    def domain(self, name: str, error: UserError) -> None:
        """Tell of a domain that cannot be meshed."""
        note(f"left out: {error}")
        found = NUMBER.search(name)
        self._polygons.append(found[1] if found else name)

    def summary(self) -> str:
        """The last line: ``part.wkt: 2 polygons left out: 4, 17``."""
        parts = []
        if self._polygons:
            count = len(self._polygons)
            more = f" and {count - LISTED} more" if count > LISTED else ""
            parts.append(f"{count} polygon{'' if count == 1 else 's'} left out: "
                         f"{', '.join(self._polygons[:LISTED])}{more}")  # fmt: skip
        if self._others:
            parts.append(f"{self._others} {'line or point' if self._others == 1 else 'lines and points'} left out")
        return f"{self._source}: {'; '.join(parts)}"
