"""Several meshes of one polygon side by side, in one scale of length and of quality."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from envs.mesh import Mesh
from freemesh_ray.colours import INK
from freemesh_ray.plots.mesh import LEGEND, add_colour_bar, draw_panel
from freemesh_ray.plots.page import page, save

PANEL = 3.7  # inches, width of a panel
#: Width over height that the page comes near to.
LANDSCAPE = 2.2


def draw_side_by_side(meshes: Mapping[str, Mesh], path: str | Path, title: str | None = None) -> Figure:
    """Draw a panel a mesh, its figures above it; one colour bar and one legend for all.

    Args:
        meshes: label -> mesh, complete or not, in the order of the panels; at least one.
        path: PNG or SVG to write.
        title: above all.

    Raises:
        OutputError: the place cannot be written to.
        ValueError: no mesh.
    """
    if not meshes:
        raise ValueError("draw_side_by_side: no meshes: give at least one")
    points = np.concatenate([mesh.vertices for mesh in meshes.values()])
    low, high = points.min(axis=0), points.max(axis=0)
    width, height = np.maximum(high - low, 1e-300)
    aspect = float(np.clip(height / width, 0.25, 2.5))
    rows = math.ceil(len(meshes) / max(1, round(math.sqrt(len(meshes) * aspect * LANDSCAPE))))
    columns = math.ceil(len(meshes) / rows)
    figure = page(columns * PANEL + 0.9, rows * (PANEL * aspect + 0.8) + (0.9 if title else 0.4))
    panels = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    marks: dict[str, Any] = {}
    for axes, (label, mesh) in zip(panels, meshes.items(), strict=False):
        draw_panel(mesh, axes, label, PANEL)
        margin = 0.02 * (high - low)
        axes.set(xlim=(low[0] - margin[0], high[0] + margin[0]), ylim=(low[1] - margin[1], high[1] + margin[1]))
        handles, labels = axes.get_legend_handles_labels()
        marks |= dict(zip(labels, handles, strict=True))
    for axes in panels[len(meshes) :]:
        axes.remove()
    add_colour_bar(figure, panels[: len(meshes)], rows)
    if marks:
        figure.legend(marks.values(), marks.keys(), loc="outside lower center", **LEGEND)
    if title is not None:
        figure.suptitle(title, color=INK, fontsize=14, fontweight="bold")
    save(figure, path)
    return figure
