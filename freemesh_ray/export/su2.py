"""SU2's ``.su2``: elements, points, and a marker for each side of the boundary."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from freemesh_ray.export.finite_elements import FiniteElements

#: Kinds of elements, as VTK numbers them, by dimension.
TYPES = {1: 3, 2: 9, 3: 12}


def write(mesh: FiniteElements, path: Path) -> None:
    """Write elements of order 1."""
    path.write_bytes("\n".join([*_lines(mesh), ""]).encode("ascii"))


def _lines(mesh: FiniteElements) -> Iterator[str]:
    d = mesh.kind.dimension
    yield from (f"% {mesh.title}", f"NDIME= {d}", f"NELEM= {len(mesh.elements)}")
    yield from (f"{TYPES[d]} {' '.join(map(str, nodes))} {i}" for i, nodes in enumerate(mesh.elements.tolist()))
    yield f"NPOIN= {len(mesh.nodes)}"
    yield from (f"{' '.join(map(repr, point))} {i}" for i, point in enumerate(mesh.nodes.tolist()))
    yield f"NMARK= {len(mesh.sides)}"
    for side in mesh.sides:
        yield from (f"MARKER_TAG= {side.name}", f"MARKER_ELEMS= {len(side.facets)}")
        yield from (f"{TYPES[d - 1]} {' '.join(map(str, nodes))}" for nodes in side.facets.tolist())
