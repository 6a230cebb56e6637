"""What is measured and drawn: our meshes, and those of others, which may hold triangles."""

from __future__ import annotations

from typing import Protocol

from envs.types import Floats, Ints


class PlaneMesh(Protocol):
    """A mesh of quadrilaterals in the plane, and of triangles where its mesher left some."""

    @property
    def vertices(self) -> Floats:
        """(n, 2) float64."""

    @property
    def quads(self) -> Ints:
        """(m, 4) int64 indices into ``vertices``, counter-clockwise."""

    @property
    def triangles(self) -> Ints:
        """(t, 3) int64 indices into ``vertices``, counter-clockwise."""

    @property
    def segments(self) -> Ints:
        """(s, 2) int64: the boundary."""

    @property
    def complete(self) -> bool:
        """Whether the elements fill the domain."""

    @property
    def edges(self) -> tuple[Ints, Ints]:
        """Distinct undirected edges (e, 2) int64, and how many elements use each, (e,) int64."""

    @property
    def valence(self) -> Ints:
        """(n,) int64: edges that meet at each vertex."""
