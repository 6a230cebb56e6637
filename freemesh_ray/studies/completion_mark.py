"""What says that a run folder's training came to its end."""

from __future__ import annotations

from typing import Any

from freemesh_ray.storage.json_file import read_json
from freemesh_ray.training.run_folder import RunFolder

#: Says that a run folder's training came to its end, and holds its last figures; the last file written.
FINISHED = "finished.json"


def finished(folder: RunFolder) -> dict[str, Any] | None:
    """The last figures of a training that came to its end; None where it did not, or where they are damaged."""
    try:
        figures = read_json(folder.path / FINISHED)
    except (OSError, ValueError):
        return None
    return figures if isinstance(figures, dict) else None
