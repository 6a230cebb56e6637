"""What a request may cost."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """The limits of a request.

    Attributes:
        body_bytes: of a polygon's text.
        vertices: of a boundary, those that ``edge_length`` adds included.
        seconds: wall time of a mesh, from parsing to writing.
        best_of: meshes to choose from.
        waiting: requests that may wait for a free mesher; further ones are turned away.
        at_once: requests to mesh that may be in the server at all; with ``body_bytes`` this bounds its memory.
        upload_seconds: until a body has arrived.
    """

    body_bytes: int = 8_000_000
    vertices: int = 10_000
    seconds: float = 30.0
    best_of: int = 8
    waiting: int = 32
    at_once: int = 64
    upload_seconds: float = 30.0
