"""Netgen's quad-dominated mesher on a fixed boundary."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from envs.polygons.rings import loops
from envs.types import Domain
from freemesh_ray.compare.mixed_mesh import MixedMesh, PeerError, assembled

#: Tried until there is a mesh that divides no given segment: the higher, the finer Netgen wants it near short segments.
SEGMENTS_PER_EDGE = (0.7, 0.5, 0.2, 0.1)

UNLIMITED = 1e9


def mesh(domain: Domain, name: str) -> MixedMesh:
    """Mesh a domain; ``seconds`` is the wall time of the call that made it.

    Raises:
        PeerError: Netgen failed.
        ImportError: Netgen is not installed.
    """
    made, seconds, failure = None, 0.0, ""
    for least in SEGMENTS_PER_EDGE:
        geometry = polygon(domain)
        start = time.perf_counter()
        try:
            made = geometry.GenerateMesh(maxh=UNLIMITED, quad_dominated=True, segmentsperedge=least)
        except Exception as error:  # Netgen has no type of its own
            failure = str(error).strip() or "failed without a message"
            continue
        seconds = time.perf_counter() - start
        if len(made.Elements1D()) == len(domain.segments):
            break
    if made is None:
        raise PeerError(failure)
    # Netgen counts from 1.
    vertices = np.array([(0.0, 0.0), *((point[0], point[1]) for point in made.Points())])
    elements = [[vertex.nr for vertex in element.vertices] for element in made.Elements2D()]
    quads, triangles = ([element for element in elements if len(element) == count] for count in (4, 3))
    return assembled(name, vertices, quads, triangles, seconds)


def polygon(domain: Domain) -> Any:
    """The domain as Netgen's geometry: an edge for each given segment, the inside to its left."""
    from netgen.geom2d import SplineGeometry

    geometry = SplineGeometry()
    for loop in loops(domain.segments):
        tags = [geometry.AppendPoint(*point) for point in domain.points[loop].tolist()]
        for a, b in zip(tags, tags[1:] + tags[:1], strict=True):
            geometry.Append(["line", a, b], leftdomain=1, rightdomain=0)
    return geometry
