"""The picture of a mesh: quadrilaterals coloured by quality, the boundary in bold, irregular nodes marked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PathCollection, PolyCollection
from matplotlib.figure import Figure, SubFigure

from envs.mesh import Mesh
from envs.quality import element_quality
from freemesh_ray.mesh_geometry.metrics import irregular, measure
from freemesh_ray.mesh_geometry.protocol import PlaneMesh
from freemesh_ray.plots.colours import COLOURS, FEW, FRONT, INK, MANY, QUALITY, TRIANGLE
from freemesh_ray.plots.page import WIDTH, page, png_of, save

#: Irregular nodes by valence: (lowest, highest) -> marker, colour, label.
IRREGULAR: dict[tuple[float, float], tuple[str, str, str]] = {
    (0, 3): ("v", FEW, "valence 3"),
    (5, np.inf): ("s", MANY, "valence 5 and more"),
}
#: Points, width of the boundary's lines in a picture of the full width.
BOLD = 1.6
#: Of the lines inside that have names.
LINE = 1.0


def draw_mesh(
    mesh: Mesh, path: str | Path | None = None, title: str | None = None, ax: Axes | None = None
) -> Figure | SubFigure:
    """Draw elements coloured by quality, the given boundary in bold, irregular interior nodes marked, figures above.

    Args:
        mesh: what is not meshed of an incomplete one stays white, and its front is drawn in red.
        path: PNG or SVG to write; None: none.
        title: above the mesh; None: the mesh's name.
        ax: axes to draw in, without colour bar; None: a figure of its own.

    Returns:
        The figure drawn in.

    Raises:
        OutputError: the place cannot be written to.
    """
    figure: Figure | SubFigure
    if ax is None:
        width, height = np.ptp(mesh.vertices, axis=0)
        figure = page(WIDTH, float(np.clip(WIDTH * 0.86 * height / max(width, 1e-300), 2.0, 10.0)) + 1.0)
        axes = figure.add_subplot()
        add_colour_bar(figure, [axes])
    else:
        axes, figure = ax, ax.figure
    draw_panel(mesh, axes, mesh.name if title is None else title)
    for segments in mesh.groups.lines.values():
        axes.add_collection(LineCollection(list(mesh.vertices[segments]), colors=INK, linewidths=LINE, zorder=4))
    add_legend(axes, marks(axes), loc="upper center", bbox_to_anchor=(0.5, 0.0))
    if path is not None:
        save(figure, path)
    return figure


def mesh_png(mesh: Mesh) -> bytes:
    """The picture of `draw_mesh`, 100 dots an inch, as a PNG's bytes."""
    figure = draw_mesh(mesh)
    return png_of(figure)


def draw_panel(mesh: PlaneMesh, axes: Axes, title: str, width: float = WIDTH) -> None:
    """Draw a mesh into axes that are ``width`` inches wide, title and figures above; triangles are red.

    Lines and marks get finer as elements get smaller.
    """
    fine = float(np.clip(12.0 / np.sqrt(len(mesh.quads) + len(mesh.triangles) + 1.0) * width / WIDTH, 0.15, 0.7))
    if len(mesh.quads):
        elements = PolyCollection(list(mesh.vertices[mesh.quads]), cmap=COLOURS, norm=QUALITY, linewidths=fine)
        elements.set_array(element_quality(mesh.vertices, mesh.quads))
        elements.set_edgecolor("white")
        axes.add_collection(elements)
    if len(mesh.triangles):
        axes.add_collection(
            PolyCollection(
                list(mesh.vertices[mesh.triangles]), facecolors=TRIANGLE, edgecolors="white", linewidths=fine,
                label="triangle",
            )
        )  # fmt: skip
    if not mesh.complete:
        axes.add_collection(LineCollection(list(mesh.vertices[front(mesh)]), colors=FRONT, linewidths=1.2, zorder=3))
    bold = BOLD * np.sqrt(width / WIDTH)
    axes.add_collection(
        LineCollection(list(mesh.vertices[mesh.segments]), colors=INK, linewidths=bold, capstyle="round", zorder=4)
    )
    nodes, valence = irregular(mesh), mesh.valence
    for (low, high), (marker, colour, label) in IRREGULAR.items():
        points = mesh.vertices[nodes[(valence[nodes] >= low) & (valence[nodes] <= high)]]
        if len(points):
            axes.scatter(
                points[:, 0], points[:, 1], s=max(50 * fine, 9), marker=marker, color=colour, label=label,
                edgecolors="white", linewidths=fine / 2, zorder=5,
            )  # fmt: skip
    axes.set_aspect("equal", anchor="N")  # the layout leaves room for the title only above the given place
    axes.set_axis_off()
    axes.autoscale_view()
    axes.margins(0.02)
    axes.set_title(title, color=INK, fontsize=12, fontweight="bold", pad=31)
    axes.annotate(
        caption(mesh), (0.5, 1.0), (0, 3), xycoords="axes fraction", textcoords="offset points",
        ha="center", va="bottom", color=INK if mesh.complete else FRONT, fontsize=9, linespacing=1.35,
    )  # fmt: skip


def add_colour_bar(figure: Figure, panels: Sequence[Axes], rows: int = 1) -> None:
    """The scale of element quality, beside the panels, which stand in so many rows."""
    bar = figure.colorbar(
        ScalarMappable(QUALITY, COLOURS), ax=panels, shrink=0.72, aspect=28 * rows, pad=0.02, panchor=False
    )
    bar.set_label("element quality η", color=INK)
    bar.outline.set_visible(False)  # type: ignore[operator]


def marks(axes: Axes) -> dict[str, Artist]:
    """What a panel's legend explains: label -> what is drawn."""
    handles, labels = axes.get_legend_handles_labels()
    return dict(zip(labels, handles, strict=True))


def add_legend(owner: Axes | Figure, entries: Mapping[str, Artist], **place: Any) -> None:
    """The legend in one row, with marks of one size however small they are in the picture; none without entries."""
    if not entries:
        return
    legend = owner.legend(
        entries.values(), entries.keys(), ncols=len(entries), frameon=False, fontsize=8, handlelength=1,
        handletextpad=0.4, **place,
    )  # fmt: skip
    for handle in legend.legend_handles:
        if isinstance(handle, PathCollection):
            handle.set_sizes([24.0])


def caption(mesh: PlaneMesh) -> str:
    """The figures of a mesh on two lines: how many elements and irregular nodes, complete or not; the quality."""
    counts = [_counted(len(mesh.quads), "quad" if len(mesh.triangles) else "element")]
    if len(mesh.triangles):
        counts.append(_counted(len(mesh.triangles), "triangle"))
    counts.append(_counted(len(irregular(mesh)), "irregular node"))
    lines = [" · ".join(counts if mesh.complete else ["INCOMPLETE", *counts])]
    if len(mesh.quads):
        figures = measure(mesh)
        parts = (f"{name} {figures[key]:.3f}" for name, key in (("mean", "eta"), ("p5", "eta_p5"), ("min", "eta_min")))
        lines.append("η " + " · ".join(parts))
    return "\n".join(lines)


def _counted(number: int, noun: str) -> str:
    return f"{number:,} {noun}" if number == 1 else f"{number:,} {noun}s"


def front(mesh: PlaneMesh) -> np.ndarray:
    """(e, 2) int64: edges that still wait for an element, the given boundary's apart."""
    edges, counts = mesh.edges
    given = {tuple(edge) for edge in np.sort(mesh.segments, axis=1).tolist()}
    waiting = [edge for edge in edges[counts == 1].tolist() if tuple(edge) not in given]
    return np.array(waiting, dtype=np.int64).reshape(-1, 2)
