"""How many elements a mesh will have, told from its boundary before any of it is made.

A mesh keeps its boundary's segments, and its elements are about as large inside as there: about one for each square of
the mean segment in the area, and half a one for each segment. Of 480 meshes (catalogue, random and graded domains, all
densities) each had 0.3 to 2.1 times as many, nine of ten 0.5 to 1.5 times; very uneven boundaries give far fewer.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from envs.polygons.rings import EDGE_LENGTH, signed_area
from envs.types import Domain, DomainError, Floats

#: Expected elements above which a mesh is made only when that is asked for.
MOST_ELEMENTS = 2_000_000

#: What messages call the option that asks for it, on the command line and in Python.
ALLOW_LARGE = "--yes (allow_large=True in Python)"


def expected_elements(area: float, length: float, segments: float) -> float:
    """Elements of a mesh, roughly; above 1e18 where the numbers say so.

    Args:
        area: of the domain.
        length: of its boundary, holes included.
        segments: of its boundary; at least 1.
    """
    with np.errstate(over="ignore"):
        return float(np.float64(area) * (segments / np.float64(length)) ** 2 + 0.5 * segments)


def expected_in_domain(domain: Domain) -> float:
    """Elements of the mesh of a domain, roughly."""
    ends = domain.points[domain.kept]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum()
    return expected_elements(domain.area, length, len(ends))


def expected_in_rings(rings: Sequence[Floats], edge_length: float) -> float:
    """Elements of the mesh of rings, each (n, 2), the outer one first, once they are split by an edge length."""
    area = abs(signed_area(rings[0])) - sum(abs(signed_area(ring)) for ring in rings[1:])
    length = float(sum(np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1).sum() for ring in rings))
    return expected_elements(area, length, max(length / edge_length, 1.0))


def check_elements(expected: float, source: str, most: float = MOST_ELEMENTS) -> None:
    """Refuse a mesh of more than ``most`` expected elements.

    Raises:
        DomainError: the source, the numbers and the fix in one line.
    """
    if expected > most:
        raise DomainError(
            f"{source}: a mesh of about {expected:,.0f} elements, at most {most:,.0f} are made unless asked for; use a "
            f"larger {EDGE_LENGTH} or a simpler boundary, or ask for it with {ALLOW_LARGE}"
            if expected < 1e18
            else f"{source}: a mesh of more than 1e18 elements; use a larger {EDGE_LENGTH}"
        )
