"""A solid mesh of hexahedra, such as a plane one was swept into, as finite elements of 8 or 20 nodes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Protocol

import numpy as np

from envs.types import Floats, Ints
from freemesh_ray.export.element_kinds import Kind, hexahedron
from freemesh_ray.export.facets import behind, sides_of
from freemesh_ray.export.finite_elements import Facets, FiniteElements, NodeSet
from freemesh_ray.export.names import free
from freemesh_ray.export.regions import partition

#: What outer faces without a name are called.
BOUNDARY = "boundary"


class SolidGroups(Protocol):
    """The parts of a solid mesh that have names."""

    @property
    def faces(self) -> Mapping[str, Ints]:
        """(k, 4 or 8) int64 outer faces, counter-clockwise from outside."""

    @property
    def interfaces(self) -> Mapping[str, Ints]:
        """(k, 4 or 8) int64 faces inside."""

    @property
    def regions(self) -> Mapping[str, Ints]:
        """(k,) int64 hexahedra."""

    @property
    def edges(self) -> Mapping[str, Ints]:
        """(k, 2 or 3) int64 edges."""


class SolidMesh(Protocol):
    """A mesh of hexahedra."""

    @property
    def name(self) -> str:
        """The domain's."""

    @property
    def nodes(self) -> Floats:
        """(n, 3) float64."""

    @property
    def hexes(self) -> Ints:
        """(m, 8 or 20) int64, as `element_kinds.hexahedron` has them."""

    @property
    def groups(self) -> SolidGroups:
        """The parts that have names."""


def solid_elements(mesh: SolidMesh) -> FiniteElements:
    """The elements of a mesh and its parts; elements without a name are ``domain``, outer faces ``boundary``."""
    kind, elements = hexahedron(mesh.hexes.shape[1]), mesh.hexes.astype(np.int64)
    groups = mesh.groups
    return FiniteElements(
        name=mesh.name,
        nodes=np.asarray(mesh.nodes, dtype=np.float64),
        elements=elements,
        kind=kind,
        eta=None,
        sides=tuple(_sides(groups.faces, elements, kind)),
        lines=tuple(_facets(name, faces, elements, kind) for name, faces in groups.interfaces.items() if len(faces)),
        regions=partition(groups.regions, len(elements)),
        points=tuple(NodeSet(name, edges) for name, edges in groups.edges.items() if len(edges)),
    )


def _facets(name: str, wanted: Ints, elements: Ints, kind: Kind) -> Facets:
    _, element, side = behind(elements, kind, wanted)
    facets = sides_of(elements, kind)[element, side]
    return Facets(name, np.unique(facets), element, side, facets)


def _sides(faces: Mapping[str, Ints], elements: Ints, kind: Kind) -> Iterator[Facets]:
    """The outer faces, each in one part."""
    every = sides_of(elements, kind)
    corners = np.sort(every[..., :4].reshape(-1, 4), axis=1)
    _, number, count = np.unique(corners, axis=0, return_inverse=True, return_counts=True)
    left = (count[number.reshape(-1)] == 1).reshape(every.shape[:2])
    for name, wanted in faces.items():
        part = _facets(name, wanted, elements, kind)
        mine = left[part.elements, part.sides]
        left[part.elements, part.sides] = False
        if mine.any():
            facets = part.facets[mine]
            yield Facets(name, np.unique(facets), part.elements[mine], part.sides[mine], facets)
    if left.any():
        element, side = np.nonzero(left)
        facets = every[element, side]
        yield Facets(free(BOUNDARY, set(faces)), np.unique(facets), element, side, facets)
