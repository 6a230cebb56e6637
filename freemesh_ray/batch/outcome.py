"""What became of one file of many."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from envs.errors import FAILED


@dataclass
class Outcome:
    """Of one file.

    Attributes:
        meshes: of each mesh its ``quality()``.
        notes: what the user is to be told, a line each.
        error: why there is no mesh, or not all of it; empty: nothing is wrong.
        code: the exit code that goes with the error; 0: none.
        seconds: wall time.
        files: the contents of the files, by name, where they are not in the folder already.
        skipped: the file was meshed before.
    """

    meshes: list[Mapping[str, float]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    error: str = ""
    code: int = 0
    seconds: float = 0.0
    files: dict[str, bytes] = field(default_factory=dict)
    skipped: bool = False

    @classmethod
    def died(cls, source: str, how: str) -> Outcome:
        """Of a file whose process is gone."""
        return cls(
            error=f"{source}: its process died ({how}): memory may have been short, try fewer --jobs", code=FAILED
        )
