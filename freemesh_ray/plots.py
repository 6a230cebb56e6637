"""Pictures of meshes and of learning curves, PNG or SVG by the file's extension.

Everything is drawn on `Figure` objects of its own, without pyplot: no window, no state shared between callers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure, SubFigure
from numpy.typing import ArrayLike

from envs.mesh import Mesh
from envs.quality import element_quality
from freemesh_ray.atomic import replacing
from freemesh_ray.metrics import irregular

#: One run's curve: steps and values, of one length.
Curve = tuple[ArrayLike, ArrayLike]

#: Element quality is always drawn on this scale, so that pictures compare.
QUALITY, COLOURS = Normalize(0.0, 1.0), "viridis"
INK, FRONT = "#1a1a1a", "#c0392b"
#: Irregular nodes by valence: (lowest, highest) -> marker, colour, label.
IRREGULAR: dict[tuple[float, float], tuple[str, str, str]] = {
    (0, 3): ("v", "#ff7f0e", "valence 3"),
    (5, np.inf): ("s", "#e3208f", "valence 5 and more"),
}
CURVES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#1a1a1a")
DPI, WIDTH = 160, 7.0  # inches
#: Kinds of picture.
SUFFIXES = (".png", ".svg")


def draw_mesh(
    mesh: Mesh, path: str | Path | None = None, title: str | None = None, ax: Axes | None = None
) -> Figure | SubFigure:
    """Draw elements coloured by quality, the given boundary in bold, irregular interior nodes marked, figures below.

    Args:
        mesh: what is not meshed of an incomplete one stays white, and its front is drawn in red.
        path: PNG or SVG to write; None: none.
        title: above the mesh; None: the mesh's name.
        ax: axes to draw in, without colour bar; None: a figure of its own.

    Returns:
        The figure drawn in.
    """
    size = np.ptp(mesh.vertices, axis=0)
    figure: Figure | SubFigure
    if ax is None:
        height = float(np.clip(WIDTH * 0.86 * size[1] / max(size[0], 1e-300), 2.0, 10.0))
        figure = Figure(figsize=(WIDTH, height + 1.0), dpi=DPI, layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.add_subplot()
        bar = figure.colorbar(ScalarMappable(QUALITY, COLOURS), ax=axes, shrink=0.72, aspect=28, pad=0.02)
        bar.set_label("element quality $\\eta$", color=INK)
        bar.outline.set_visible(False)  # type: ignore[operator]
    else:
        axes, figure = ax, ax.figure
    _draw(mesh, axes)
    axes.set_title(title or mesh.name, color=INK, fontsize=12, fontweight="bold")
    axes.text(
        0.5, -0.02, caption(mesh), transform=axes.transAxes, ha="center", va="top",
        color=INK if mesh.complete else FRONT, fontsize=9,
    )  # fmt: skip
    if path is not None:
        _save(figure, path)
    return figure


def caption(mesh: Mesh) -> str:
    """The figures below a mesh, and whether it is complete."""
    parts = [_counted(len(mesh.quads), "element")]
    if len(mesh.quads):
        parts.append(f"mean $\\eta$ {element_quality(mesh.vertices, mesh.quads).mean():.3f}")
    parts.append(_counted(len(irregular(mesh)), "irregular node"))
    return " · ".join(([] if mesh.complete else ["INCOMPLETE"]) + parts)


def draw_curves(
    series: Mapping[str, Curve | Sequence[Curve]],
    path: str | Path,
    xlabel: str = "env steps",
    ylabel: str = "",
    title: str | None = None,
) -> Figure:
    """Draw learning curves: one line a label; of several seeds their mean, in the band from the least to the largest.

    Args:
        series: label -> (steps, values), or a list of such, one for each seed; seeds may have other steps, they are
            interpolated where all of them have values. NaN values are left out.
        path: PNG or SVG to write.
    """
    figure = Figure(figsize=(WIDTH, 4.2), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for i, (label, curves) in enumerate(series.items()):
        colour = CURVES[i % len(CURVES)]
        steps, values = _aligned([curves] if isinstance(curves, tuple) else curves)
        if not len(steps):
            continue
        name = label if len(values) == 1 else f"{label} (mean of {len(values)} seeds)"
        if len(values) > 1:
            axes.fill_between(steps, values.min(axis=0), values.max(axis=0), color=colour, alpha=0.18, linewidth=0)
        axes.plot(steps, values.mean(axis=0), color=colour, linewidth=1.8, label=name)
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)
    axes.set_title(title or "", color=INK, fontsize=12, fontweight="bold")
    axes.xaxis.set_major_formatter(matplotlib.ticker.EngFormatter(sep=""))
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0.01)
    if axes.has_data():
        axes.legend(frameon=False, loc="best")
    _save(figure, path)
    return figure


def _draw(mesh: Mesh, axes: Axes) -> None:
    """The mesh itself; lines get thinner, and marks smaller, as elements get smaller."""
    fine = float(np.clip(12.0 / np.sqrt(len(mesh.quads) + 1.0), 0.15, 0.7))
    if len(mesh.quads):
        elements = PolyCollection(list(mesh.vertices[mesh.quads]), cmap=COLOURS, norm=QUALITY, linewidths=fine)
        elements.set_array(element_quality(mesh.vertices, mesh.quads))
        elements.set_edgecolor("white")
        axes.add_collection(elements)
    if not mesh.complete:
        axes.add_collection(LineCollection(list(mesh.vertices[_front(mesh)]), colors=FRONT, linewidths=1.2, zorder=3))
    axes.add_collection(
        LineCollection(list(mesh.vertices[mesh.segments]), colors=INK, linewidths=1.6, capstyle="round", zorder=4)
    )
    nodes, valence = irregular(mesh), mesh.valence
    for (low, high), (marker, colour, label) in IRREGULAR.items():
        points = mesh.vertices[nodes[(valence[nodes] >= low) & (valence[nodes] <= high)]]
        if len(points):
            axes.scatter(
                points[:, 0], points[:, 1], s=max(50 * fine, 9), marker=marker, color=colour, label=label,
                edgecolors="white", linewidths=fine / 2, zorder=5,
            )  # fmt: skip
    if axes.get_legend_handles_labels()[0]:
        axes.legend(
            loc="upper center", bbox_to_anchor=(0.5, -0.06), ncols=2, frameon=False, fontsize=8, handletextpad=0
        )
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.autoscale_view()
    axes.margins(0.02)


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _front(mesh: Mesh) -> np.ndarray:
    """(e, 2) int64: edges that still wait for an element, the given boundary's apart."""
    edges, counts = mesh.edges
    given = {tuple(edge) for edge in np.sort(mesh.segments, axis=1).tolist()}
    waiting = [edge for edge in edges[counts == 1].tolist() if tuple(edge) not in given]
    return np.array(waiting, dtype=np.int64).reshape(-1, 2)


def _aligned(curves: Sequence[Curve]) -> tuple[np.ndarray, np.ndarray]:
    """Steps (t,) that all seeds cover, and their values there, (seeds, t)."""
    clean = []
    for steps, values in curves:
        x, y = np.asarray(steps, dtype=np.float64), np.asarray(values, dtype=np.float64)
        known = np.isfinite(x) & np.isfinite(y)
        order = np.argsort(x[known], kind="stable")
        if known.any():
            clean.append((x[known][order], y[known][order]))
    if not clean:
        return np.empty(0), np.empty((0, 0))
    first, last = max(x[0] for x, _ in clean), min(x[-1] for x, _ in clean)
    grid = np.unique(np.concatenate([x for x, _ in clean]))
    grid = grid[(grid >= first) & (grid <= last)]
    return grid, np.array([np.interp(grid, x, y) for x, y in clean])


def _save(figure: Figure | SubFigure, path: str | Path) -> None:
    """Write the picture; the same picture gives the same bytes."""
    path = Path(path)
    root = figure.figure if isinstance(figure, SubFigure) else figure
    svg = path.suffix.lower() == ".svg"
    with matplotlib.rc_context({"svg.hashsalt": "freemesh"}), replacing(path) as draft:
        root.savefig(draft, metadata={"Date": None} if svg else {"Software": None}, facecolor="white")
