"""A peer's mesh with as many elements as another: the size wanted inside is varied, the boundary stays.

Where the boundary is kept and all elements are quadrilaterals, as many elements are as many vertices, by Euler's
formula: as many degrees of freedom.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from envs.types import Domain
from freemesh_ray.compare.mixed_mesh import MixedMesh, PeerError

#: Numbers of elements match within this share.
TOLERANCE = 0.05
#: Meshes that a search makes at most.
TRIES = 10
#: The factors that are tried, and how near to each other two of them are not told apart.
LEAST, MOST, SAME = 0.2, 5.0, 1.005

#: Why a mesh is not matched.
CANNOT_VARY, NOTHING_TO_MATCH = "its sizes cannot be varied", "there is no mesh to match"

#: A mesh of a domain whose sizes inside are a factor times those wanted; 1 leaves them to the mesher.
Resized = Callable[[Domain, float], MixedMesh]


@dataclass(frozen=True)
class Match:
    """What a search came to.

    Attributes:
        mesh: that of all tried whose number of elements is nearest to the one wanted.
        factor: of its sizes.
        wanted: the number of elements.
        tries: meshes that were made.
    """

    mesh: MixedMesh
    factor: float
    wanted: int
    tries: int

    @property
    def share(self) -> float:
        """The mesh's elements over those wanted."""
        return len(self.mesh) / self.wanted

    @property
    def reached(self) -> bool:
        """Whether that is 1, within the tolerance."""
        return abs(self.share - 1.0) <= TOLERANCE

    def __str__(self) -> str:
        """What was reached, in words."""
        found = f"{len(self.mesh):,} elements for {self.wanted:,} at {self.factor:.2f} of the size"
        return found if self.reached else f"not matched: {found} is the nearest of {self.tries} tries"


def match(resized: Resized, domain: Domain, wanted: int) -> Match:
    """Search the factor by bisection of its logarithm, once two factors have the number between them.

    Args:
        resized: the mesher.
        domain: what it meshes.
        wanted: elements, > 0.

    Raises:
        PeerError: the mesher failed at its first try; a later failure ends the search.
    """
    finer, coarser, factor = 0.0, math.inf, 1.0
    best = Match(resized(domain, factor), factor, wanted, 1)
    found = len(best.mesh)
    for tries in range(2, TRIES + 1):
        if best.reached:
            break
        if found > wanted:
            finer = factor
        else:
            coarser = factor
        if finer and coarser < math.inf:
            factor = math.sqrt(finer * coarser)
            if coarser < SAME * finer:
                break
        else:  # elements go by the square of the size; a little beyond it is the other side
            beyond = factor * math.sqrt(found / wanted) * (1.1 if found > wanted else 1 / 1.1)
            if (factor := min(max(beyond, LEAST), MOST)) in (finer, coarser):
                break
        try:
            mesh = resized(domain, factor)
        except PeerError:
            break
        found = len(mesh)
        nearer = abs(found - wanted) < abs(len(best.mesh) - wanted)
        best = Match(mesh, factor, wanted, tries) if nearer else Match(best.mesh, best.factor, wanted, tries)
    return best
