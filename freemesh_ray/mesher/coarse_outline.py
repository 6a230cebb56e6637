"""What a user is told of an outline whose own segments are too coarse, before it is meshed."""

from __future__ import annotations

import numpy as np

from envs.polygons.coarse_places import coarse_places, suggestion
from envs.polygons.geometry import Geometry


def coarse_note(geometry: Geometry) -> str:
    """A line that names the worst place and the option that helps; empty where the outline is fine enough.

    Args:
        geometry: with its outline as given, not split.
    """
    found = sorted((place for region in geometry.regions for place in coarse_places(region.domain)),
                   key=lambda place: -place.excess)  # fmt: skip
    if not found:
        return ""
    worst, count = found[0], sum(len(region.domain.segments) for region in geometry.regions)
    area = sum(region.domain.area for region in geometry.regions)
    size = max(region.domain.diameter for region in geometry.regions)
    beside = f"a segment {worst.other:.3g} long" + (f", {worst.apart:.3g} away" if worst.apart else "")
    those = f"{len(found)} of the {count} boundary segments {'is' if len(found) == 1 else 'are'} too long"
    return (
        f"{those} for what is near: at {shown(worst.x, worst.y, size)} one of {worst.length:.3g} is beside {beside}; "
        f"{suggestion(found, area)} splits the outline"
    )


def shown(x: float, y: float, size: float) -> str:
    """A place, to four digits of a domain's size: ``(2, 0.25)``."""
    digits = 4 - int(np.floor(np.log10(size)))
    return f"({round(float(x), digits) + 0.0:.12g}, {round(float(y), digits) + 0.0:.12g})"
