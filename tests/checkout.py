"""The checkout that the tests run in, and what may lie beside it."""

from __future__ import annotations

import subprocess
from functools import cache
from pathlib import Path

#: The repository's root.
ROOT = Path(__file__).resolve().parents[1]
#: The paper authors' public polygons, where a copy lies beside the checkout; otherwise none.
REFERENCES = sorted((ROOT.parent / "shared" / "reference-domains").glob("*.json"))


@cache
def files() -> tuple[str, ...]:
    """The files that a clone would hold if all was committed, by their paths from the root."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    ).stdout.split("\0")  # fmt: skip
    return tuple(sorted({name for name in listed if name and (ROOT / name).is_file()}))
