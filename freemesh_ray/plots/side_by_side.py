"""Several meshes of one polygon side by side, in one scale of length and of quality."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from freemesh_ray.mesh_geometry.protocol import PlaneMesh
from freemesh_ray.plots.colours import FRONT, INK
from freemesh_ray.plots.mesh_plot import add_colour_bar, add_legend, draw_panel, marks
from freemesh_ray.plots.page import page, save

PANEL = 3.7  # inches, width of a panel
#: Width over height that the page comes near to.
LANDSCAPE = 2.2


def draw_side_by_side(meshes: Mapping[str, PlaneMesh | None], path: str | Path, title: str | None = None) -> Figure:
    """Draw a panel a mesh, its figures above it; one colour bar and one legend for all.

    Args:
        meshes: label -> mesh, complete or not, or None where a mesher made none; in the order of the panels, at least
            one that is a mesh.
        path: PNG or SVG to write.
        title: above all.

    Raises:
        OutputError: the place cannot be written to.
        ValueError: no mesh.
    """
    made = [mesh for mesh in meshes.values() if mesh is not None]
    if not made:
        raise ValueError("draw_side_by_side: no meshes: give at least one")
    points = np.concatenate([mesh.vertices for mesh in made])
    low, high = points.min(axis=0), points.max(axis=0)
    width, height = np.maximum(high - low, 1e-300)
    aspect = float(np.clip(height / width, 0.25, 2.5))
    rows = math.ceil(len(meshes) / max(1, round(math.sqrt(len(meshes) * aspect * LANDSCAPE))))
    columns = math.ceil(len(meshes) / rows)
    figure = page(columns * PANEL + 0.9, rows * (PANEL * aspect + 0.8) + (0.9 if title else 0.4))
    panels = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    entries: dict[str, Artist] = {}
    for axes, (label, mesh) in zip(panels, meshes.items(), strict=False):
        if mesh is None:
            _draw_failure(axes, label)
            continue
        draw_panel(mesh, axes, label, PANEL)
        margin = 0.02 * (high - low)
        axes.set(xlim=(low[0] - margin[0], high[0] + margin[0]), ylim=(low[1] - margin[1], high[1] + margin[1]))
        entries |= marks(axes)
    for axes in panels[len(meshes) :]:
        axes.remove()
    add_colour_bar(figure, panels[: len(meshes)], rows)
    add_legend(figure, entries, loc="outside lower center")
    if title is not None:
        figure.suptitle(title, color=INK, fontsize=14, fontweight="bold")
    save(figure, path)
    return figure


def _draw_failure(axes: Axes, label: str) -> None:
    """An empty panel where a mesher made no mesh."""
    axes.set_axis_off()
    axes.set_title(label, color=INK, fontsize=12, fontweight="bold", pad=31)
    axes.text(0.5, 0.5, "no mesh", transform=axes.transAxes, ha="center", va="center", color=FRONT, fontsize=11)
