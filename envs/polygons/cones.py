"""Sizes that grow from points in the plane: h(x) = min(most, min_i (h_i + k |x - x_i|))."""

from __future__ import annotations

import numpy as np

from envs.types import Floats

#: Sources whose sizes are within this factor of each other are searched together, which makes h off by at most it.
ALIKE = 1.05


class Cones:
    """The least of sources' cones.

    Args:
        sources: (m, 3) float64, x, y and h_i > 0; domain units.
        slope: k, the growth of h over a distance.
    """

    def __init__(self, sources: Floats, slope: float) -> None:
        self.slope = slope
        self.groups: list[tuple[float, Floats, object]] = []
        if not len(sources):
            return
        from scipy.spatial import cKDTree  # a quarter of a second that outlines without sources need not wait

        order = np.argsort(sources[:, 2], kind="stable")
        level = np.floor(np.log(sources[order, 2] / sources[order[0], 2]) / np.log(ALIKE))
        for group in np.split(order, np.flatnonzero(np.diff(level)) + 1):
            self.groups.append((float(sources[group[0], 2]), sources[group, 2], cKDTree(sources[group, :2])))

    def __call__(self, places: Floats, most: Floats) -> Floats:
        """(p,) h at (p, 2) places, at most ``most``, (p,)."""
        found = most.copy()
        for least, sizes, tree in self.groups:  # from the smallest up: those above what was found need no look
            low = np.flatnonzero(found > least)
            if not len(low):
                break
            reach = float(found[low].max() - least) / self.slope
            distance, nearest = tree.query(places[low], distance_upper_bound=reach)  # type: ignore[attr-defined]
            near = np.isfinite(distance)
            at = low[near]
            found[at] = np.minimum(found[at], sizes[nearest[near]] + self.slope * distance[near])
        return found
