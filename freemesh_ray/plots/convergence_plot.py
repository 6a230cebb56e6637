"""Errors against the fineness of the mesh, beside the slope of theory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullLocator

from freemesh_ray.plots.page import page, save
from freemesh_ray.plots.series import MUTED, key, line, plain


class Panel(NamedTuple):
    """One error of one problem.

    Attributes:
        title: above it.
        factor: what theory multiplies the error by where edges are halved.
        lines: mesher -> (elements, relative errors), in the order in which meshes become finer.
    """

    title: str
    factor: float
    lines: Mapping[str, tuple[Sequence[int], Sequence[float]]]


def draw_convergence(panels: Sequence[Panel], path: str | Path) -> Figure:
    """Draw a panel for each error: a line a mesher, on logarithmic scales; theory's slope dashed.

    Args:
        panels: at least one.
        path: PNG or SVG to write.

    Raises:
        OutputError: the place cannot be written to.
    """
    columns = min(3, len(panels))
    rows = -(-len(panels) // columns)
    figure = page(max(3.4 * columns, 4.5), 3.0 * rows + 0.7)
    drawn = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    meshers = list(dict.fromkeys(mesher for panel in panels for mesher in panel.lines))
    for axes, panel in zip(drawn, panels, strict=False):
        axes.set_xscale("log")
        axes.set_yscale("log")
        for mesher, (elements, errors) in panel.lines.items():
            axes.plot(elements, errors, marker="o", markersize=4, **line(meshers.index(mesher)))
        lowest = min(panel.lines.values(), key=lambda each: each[1][0])
        many = np.array([lowest[0][0], max(max(elements) for elements, _ in panel.lines.values())], dtype=np.float64)
        slope = np.log2(panel.factor) / 2  # four times the elements where edges are halved
        axes.plot(many, 0.8 * lowest[1][0] * (many / many[0]) ** slope, color=MUTED, linestyle="--", linewidth=1.0)
        axes.set_title(panel.title, fontsize=10)
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda share, place: f"{100 * share:.3g} %"))
        axes.xaxis.set_major_locator(FixedLocator(lowest[0]))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda count, place: f"{count:,.0f}"))
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_minor_locator(NullLocator())
        axes.set_xlabel("elements")
        plain(axes)
    for axes in drawn[len(panels) :]:
        axes.remove()
    handles = [Line2D([], [], marker="o", markersize=4, label=mesher, **line(i)) for i, mesher in enumerate(meshers)]
    key(figure, [*handles, Line2D([], [], color=MUTED, linestyle="--", label="theory's slope")], None)
    save(figure, path)
    return figure
