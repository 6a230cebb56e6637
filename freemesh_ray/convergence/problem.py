"""What a problem is: a domain of any fineness, and how wrong the solution on a mesh of it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from envs.polygons.validation import from_rings
from envs.types import Domain, Floats
from freemesh_ray.compare.mixed_mesh import MixedMesh


class UnsolvableError(RuntimeError):
    """A mesh on which a problem has no solution here; one line that says why."""


@dataclass(frozen=True)
class Problem:
    """A boundary value problem whose solution is known.

    Attributes:
        title: in words.
        coarsest: the edge length of the first mesh.
        domain: from an edge length to the domain.
        errors: from a mesh of it to relative errors, by name.
        factors: name -> what an error is multiplied by where the edges are halved, in theory.
    """

    title: str
    coarsest: float
    domain: Callable[[float], Domain]
    errors: Callable[[MixedMesh], Mapping[str, float]]
    factors: Mapping[str, float]


def polygon(name: str, corners: list[tuple[float, float]], edge_length: float, *holes: Floats) -> Domain:
    """A polygon whose sides are of equal segments, about ``edge_length`` long; holes are taken as they are."""
    ends = np.array(corners)
    ring = [side(a, b, edge_length) for a, b in zip(ends, np.roll(ends, -1, axis=0), strict=True)]
    return from_rings(np.concatenate(ring), holes, name=name)


def side(a: Floats, b: Floats, edge_length: float) -> Floats:
    """The points of a straight side, the last left out."""
    count = max(1, round(float(np.linalg.norm(b - a)) / edge_length))
    return a + (b - a) * np.arange(count)[:, None] / count


def circle(centre: tuple[float, float], radius: float, edge_length: float) -> Floats:
    """Points on a circle, of a number that 4 divides, clockwise."""
    count = 4 * max(2, round(np.pi * radius / (2 * edge_length)))
    angles = -2 * np.pi * np.arange(count) / count
    return np.array(centre) + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
