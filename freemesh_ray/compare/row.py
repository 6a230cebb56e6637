"""One line of the comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """A mesher on a domain.

    Attributes:
        domain: the domain's name.
        mesher: the mesher's.
        figures: of its mesh, by the names of element_metrics.figures; None when it failed.
        keeps_boundary: whether the mesh has exactly the given boundary segments.
        failure: why there is no mesh; "" when there is.
    """

    domain: str
    mesher: str
    figures: Mapping[str, float] | None
    keeps_boundary: bool
    failure: str
