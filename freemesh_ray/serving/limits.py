"""What a request may cost."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """The limits of a request, and of all of them together.

    Attributes:
        body_bytes: of a polygon's text.
        vertices: of a boundary, those that ``edge_length`` adds included.
        elements: that a mesh is expected to have.
        seconds: wall time of a mesh, from parsing to writing.
        best_of: meshes to choose from.
        worker_bytes: address space that a mesh may take, beside what a worker has when it is ready.
        quick_bytes: body of a request that may be a quick one.
        quick_expected: processor time that a quick request is expected to take, in seconds.
        quick_seconds: processor time after which a request that looked quick goes on as a costly one.
        waiting: requests that may wait for a free mesher, quick and costly ones apart, half of them of one address;
            further ones are turned away.
        uploads: bodies of more than ``quick_bytes`` that may be on their way; with ``waiting`` and ``body_bytes`` this
            bounds the memory that requests take.
        upload_seconds: until a body has arrived.
        head_seconds: until a request's head has arrived, from the connection or from the answer before it.
        idle_seconds: that a connection may be silent between two requests.
        write_seconds: that a client may leave an answer unread.
        connections: open at a time, fewer where the process may not have as many descriptors; one address may have
            half of them.
    """

    body_bytes: int = 8_000_000
    vertices: int = 10_000
    elements: int = 500_000
    seconds: float = 30.0
    best_of: int = 8
    worker_bytes: int = 2_000_000_000
    quick_bytes: int = 65_536
    quick_expected: float = 0.5
    quick_seconds: float = 1.0
    waiting: int = 32
    uploads: int = 16
    upload_seconds: float = 30.0
    head_seconds: float = 10.0
    idle_seconds: int = 5
    write_seconds: float = 30.0
    connections: int = 1000
