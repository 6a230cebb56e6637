"""Gmsh's ``.msh``, version 4.1 or 2.2, in ASCII.

Quadrilaterals first, then the boundary as lines, in physical groups ``domain`` and ``boundary``. Where the boundary has
several loops, each is a group too: ``outer``, ``hole_1``, ... Version 2.2 knows one group an element: there the lines
of such a boundary are in their loop's.

Version 4.1 has the element quality as element data ``eta``; a line's is that of the element behind it, because meshio
reads data of all elements or of none. Of version 2.2 it reads none if there is more than one kind of element.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from envs.types import Floats, Ints
from freemesh_ray.export.finite_elements import FiniteElements

#: Gmsh's numbers for kinds of elements, by the number of their nodes.
LINE, QUADRILATERAL = {2: 1, 3: 8}, {4: 3, 8: 16}
#: The one surface; the loops are the curves 1, 2, ...
SURFACE = 1
#: Physical groups have numbers that no other has, in whatever dimension; the boundary's curves follow on the domain.
DOMAIN = 1


def write(mesh: FiniteElements, path: Path, version: str) -> None:
    """Write version ``4.1`` or ``2.2`` of the format."""
    body = _version_4(mesh) if version == "4.1" else _version_2(mesh)
    path.write_bytes("\n".join([*_section("MeshFormat", [f"{version} 0 8"]), *body, ""]).encode("ascii"))


def _version_4(mesh: FiniteElements) -> Iterator[str]:
    groups = {curve.name: DOMAIN + i for i, curve in enumerate(mesh.curves, 1)}
    yield from _section("PhysicalNames", _names(groups))
    yield from _section("Entities", _entities(mesh, groups))
    yield from _section("Nodes", _node_blocks(mesh))
    yield from _section("Elements", _element_blocks(mesh))
    yield from _section("ElementData", _quality(mesh))


def _version_2(mesh: FiniteElements) -> Iterator[str]:
    curves = mesh.loops if len(mesh.loops) > 1 else (mesh.boundary,)
    yield from _section("PhysicalNames", _names({curve.name: DOMAIN + i for i, curve in enumerate(curves, 1)}))
    nodes = (f"{i} {_point(*point)}" for i, point in enumerate(mesh.nodes.tolist(), 1))
    yield from _section("Nodes", [str(len(mesh.nodes)), *nodes])
    # Tags of an element: how many, its physical group, its surface or curve.
    rows = list(_tagged(mesh.elements, QUADRILATERAL, f"2 {DOMAIN} {SURFACE}"))
    for i, curve in enumerate(curves, 1):
        rows += _tagged(curve.lines, LINE, f"2 {DOMAIN + i} {i}")
    yield from _section("Elements", [str(len(rows)), *(f"{i} {row}" for i, row in enumerate(rows, 1))])


def _section(name: str, lines: Iterable[str]) -> Iterator[str]:
    yield f"${name}"
    yield from lines
    yield f"$End{name}"


def _names(groups: dict[str, int]) -> Iterator[str]:
    """Dimension, number and name of the physical groups."""
    yield str(1 + len(groups))
    yield from (f'1 {tag} "{name}"' for name, tag in groups.items())
    yield f'2 {DOMAIN} "domain"'


def _entities(mesh: FiniteElements, groups: dict[str, int]) -> Iterator[str]:
    """Number, bounding box, physical groups and bounds of every loop (closed: none) and of the surface (the loops)."""
    yield f"0 {len(mesh.loops)} 1 0"
    for i, loop in enumerate(mesh.loops, 1):
        tags = [groups[name] for name in ("boundary", loop.name) if name in groups]
        yield f"{i} {_box(mesh.nodes[loop.nodes])} {_list(tags)} 0"
    yield f"{SURFACE} {_box(mesh.nodes)} {_list([DOMAIN])} {_list(range(1, len(mesh.loops) + 1))}"


def _node_blocks(mesh: FiniteElements) -> Iterator[str]:
    """Runs of nodes on one loop or inside, so that the nodes of the file are in the order of their numbers."""
    loop = np.zeros(len(mesh.nodes), dtype=np.int64)
    for i, curve in enumerate(mesh.loops, 1):
        loop[curve.nodes] = i
    runs = np.split(np.arange(len(loop)), np.flatnonzero(np.diff(loop)) + 1)
    yield f"{len(runs)} {len(loop)} 1 {len(loop)}"
    for run in runs:
        curve_number = loop[run[0]]
        yield f"{f'1 {curve_number}' if curve_number else f'2 {SURFACE}'} 0 {len(run)}"
        yield from map(str, (run + 1).tolist())
        yield from (_point(*point) for point in mesh.nodes[run].tolist())


def _element_blocks(mesh: FiniteElements) -> Iterator[str]:
    blocks = [(f"2 {SURFACE}", QUADRILATERAL, mesh.elements)]
    blocks += [(f"1 {i}", LINE, loop.lines) for i, loop in enumerate(mesh.loops, 1) if len(loop.lines)]
    total = sum(len(nodes) for _, _, nodes in blocks)
    yield f"{len(blocks)} {total} 1 {total}"
    number = 1
    for entity, kinds, nodes in blocks:
        yield f"{entity} {kinds[nodes.shape[1]]} {len(nodes)}"
        yield from (f"{i} {' '.join(map(str, row))}" for i, row in enumerate((nodes + 1).tolist(), number))
        number += len(nodes)


def _tagged(nodes: Ints, kinds: dict[int, int], tags: str) -> Iterable[str]:
    """Elements of version 2.2 without their numbers."""
    return (f"{kinds[nodes.shape[1]]} {tags} {' '.join(map(str, row))}" for row in (nodes + 1).tolist())


def _quality(mesh: FiniteElements) -> Iterator[str]:
    """A view: its name, its time, then step, components and count, and a value an element."""
    eta = np.concatenate([mesh.eta, *(mesh.eta[loop.elements] for loop in mesh.loops)])
    yield from ("1", '"eta"', "1", "0.0", "3", "0", "1", str(len(eta)))
    yield from (f"{i} {value!r}" for i, value in enumerate(eta.tolist(), 1))


def _box(points: Floats) -> str:
    return f"{_point(*points.min(axis=0).tolist())} {_point(*points.max(axis=0).tolist())}"


def _point(x: float, y: float) -> str:
    return f"{x!r} {y!r} 0.0"


def _list(numbers: Iterable[int]) -> str:
    """How many, then they."""
    numbers = list(numbers)
    return " ".join(map(str, [len(numbers), *numbers]))
