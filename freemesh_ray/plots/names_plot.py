"""The picture of a geometry's names: sides and lines in colours, regions shaded, each with its name beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection

from envs.polygons.geometry import Geometry, Region
from envs.types import Floats
from freemesh_ray.plots.colours import INK, SERIES
from freemesh_ray.plots.page import WIDTH, page, save

#: How dark regions are.
SHADE = 0.12


def draw_names(geometry: Geometry, path: str | Path) -> None:
    """Draw what of a geometry has names.

    Args:
        geometry: its segments without a name are drawn thin.
        path: PNG or SVG to write.

    Raises:
        OutputError: the place cannot be written to.
    """
    points = np.concatenate([region.domain.points for region in geometry.regions])
    width, height = np.ptp(points, axis=0)
    figure = page(WIDTH, float(np.clip(WIDTH * 0.86 * height / max(width, 1e-300), 2.0, 10.0)) + 0.8)
    axes = figure.add_subplot()
    names = list(dict.fromkeys(name for region in geometry.regions for name in region.sides))
    colours = {name: SERIES[i % (len(SERIES) - 1)] for i, name in enumerate(names)}
    for i, region in enumerate(geometry.regions):
        draw_region(axes, region, SERIES[i % (len(SERIES) - 1)] if len(geometry.regions) > 1 else INK)
        for name, segments in region.sides.items():
            stretch = region.domain.points[segments]
            axes.add_collection(LineCollection(list(stretch), colors=colours[name], linewidths=2.6, label=name))
    for name in names:
        write_beside(axes, name, longest_stretch(geometry, name), colours[name])
    axes.set_aspect("equal", anchor="N")
    axes.set_axis_off()
    axes.autoscale_view()
    axes.margins(0.08)
    axes.set_title(geometry.name, color=INK, fontsize=12, fontweight="bold")
    save(figure, path)


def draw_region(axes: Axes, region: Region, colour: str) -> None:
    """Shade a region, draw its boundary thin and write its name inside."""
    domain = region.domain
    axes.add_collection(PolyCollection([domain.vertices], facecolors=colour, alpha=SHADE, edgecolors="none"))
    axes.add_collection(LineCollection(list(domain.points[domain.segments]), colors=INK, linewidths=0.7))
    if region.name:
        x, y = inside(domain.vertices)
        axes.annotate(region.name, (x, y), ha="center", va="center", color=colour, fontsize=10, fontweight="bold")


def inside(ring: Floats) -> Floats:
    """(2,) a place inside a ring, far from its sides where it is simple."""
    import shapely

    return shapely.get_coordinates(shapely.point_on_surface(shapely.Polygon(ring).buffer(0)))[0]


def longest_stretch(geometry: Geometry, name: str) -> Floats:
    """(2, 2) the segment that a name is written beside: the middle one of its segments in the first region with it."""
    for region in geometry.regions:
        if name in region.sides:
            segments = region.sides[name]
            return region.domain.points[segments[len(segments) // 2]]
    raise KeyError(name)


def write_beside(axes: Axes, name: str, stretch: Floats, colour: str) -> None:
    """Write a name beside a segment, on its outer side: the domain is on the left."""
    ahead = stretch[1] - stretch[0]
    outwards = np.array([ahead[1], -ahead[0]]) / max(float(np.linalg.norm(ahead)), 1e-300)
    axes.annotate(
        name, tuple(stretch.mean(axis=0)), tuple(11.0 * outwards), textcoords="offset points", color=colour,
        ha="center" if abs(outwards[0]) < 0.5 else ("left" if outwards[0] > 0 else "right"),
        va="center" if abs(outwards[1]) < 0.5 else ("bottom" if outwards[1] > 0 else "top"),
        fontsize=9, fontweight="bold",
    )  # fmt: skip
