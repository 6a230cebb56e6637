"""Box plots that compare meshers: a panel for each metric, a box for each mesher over its meshes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from envs.types import Floats
from freemesh_ray.colours import INK, SERIES
from freemesh_ray.plots.page import page, save

#: Metrics by their names in metrics.measure -> what panels call them, and which way is better.
METRICS: dict[str, tuple[str, str]] = {
    "eta": ("element quality $\\eta$", "higher"),
    "scaled_jacobian": ("scaled Jacobian", "higher"),
    "stretch": ("stretch", "higher"),
    "taper": ("taper", "lower"),
    "min_angle": ("|min angle − 90°|", "lower"),
    "max_angle": ("|max angle − 90°|", "lower"),
    "singularity": ("irregular nodes", "lower"),
    "elements": ("elements", ""),
    "triangles": ("triangles", "lower"),
    "eta_p5": ("5th percentile of $\\eta$", "higher"),
    "eta_min": ("least $\\eta$", "higher"),
}
#: The panels unless others are asked for.
PANELS = ("eta", "scaled_jacobian", "stretch", "taper", "min_angle", "max_angle", "singularity", "elements")
COLUMNS = 4


def draw_boxes(
    groups: Mapping[str, Sequence[Mapping[str, float]]],
    path: str | Path,
    metrics: Sequence[str] = PANELS,
    title: str | None = None,
) -> Figure:
    """Draw the distribution of each metric over the meshes of each mesher.

    A box reaches from the first to the third quartile, the line in it is the median, the diamond the mean; whiskers end
    at the last value within 1.5 box lengths; every mesh is a dot.

    Args:
        groups: mesher -> the figures of its meshes (metrics.measure), one entry a mesh. Values that are missing or NaN
            are left out.
        path: PNG or SVG to write.
        metrics: the panels in order, at least one: keys of the figures.
        title: above all.

    Raises:
        OutputError: the place cannot be written to.
        ValueError: no metric.
    """
    if not metrics:
        raise ValueError("draw_boxes: no metrics: name at least one")
    columns = min(COLUMNS, len(metrics))
    rows = math.ceil(len(metrics) / columns)
    names = max((len(label) for label in groups), default=0)
    height = rows * (0.8 + 0.34 * max(len(groups), 1)) + (0.5 if title else 0.1)
    figure = page(columns * 2.5 + 0.08 * names, height)
    panels = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel().tolist()
    for axes, metric in zip(panels, metrics, strict=False):
        _draw_metric(axes, metric, [_values(figures, metric) for figures in groups.values()])
    panels[0].set_yticks(range(len(groups)), groups.keys(), color=INK)
    panels[0].set_ylim(len(groups) - 0.4, -0.6)  # the first mesher on top
    for axes in panels[len(metrics) :]:
        axes.remove()
    if title is not None:
        figure.suptitle(title, color=INK, fontsize=13, fontweight="bold")
    save(figure, path)
    return figure


def _values(figures: Sequence[Mapping[str, float]], metric: str) -> Floats:
    values = np.array([entry.get(metric, np.nan) for entry in figures], dtype=np.float64)
    return values[np.isfinite(values)]


def _draw_metric(axes: Axes, metric: str, samples: Sequence[Floats]) -> None:
    label, better = METRICS.get(metric, (metric, ""))
    for row, values in enumerate(samples):
        if not len(values):
            continue
        colour = SERIES[row % len(SERIES)]
        axes.boxplot(
            values, positions=[row], orientation="horizontal", widths=0.56, patch_artist=True, showmeans=True,
            showfliers=False, manage_ticks=False,
            boxprops={"facecolor": f"{colour}40", "edgecolor": colour},
            whiskerprops={"color": colour}, capprops={"color": colour},
            medianprops={"color": colour, "linewidth": 2},
            meanprops={"marker": "D", "markersize": 4, "markerfacecolor": "white", "markeredgecolor": colour},
        )  # fmt: skip
        # Dots of a box on a few heights in turn, so that equal values do not hide each other.
        heights = row + 0.16 * (np.arange(len(values)) % 5 - 2) / 2
        axes.scatter(values, heights, s=7, color=colour, alpha=0.6, linewidths=0, zorder=3)
    axes.set_title(label, color=INK, fontsize=10, fontweight="bold", pad=16)
    if better:
        arrow = "→" if better == "higher" else "←"
        axes.annotate(
            f"{arrow} {better} is better", (0.5, 1.0), (0, 4), xycoords="axes fraction", textcoords="offset points",
            ha="center", color="#666666", fontsize=8,
        )  # fmt: skip
    axes.grid(axis="x", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.tick_params(axis="x", labelsize=8)
    axes.locator_params(axis="x", nbins=5)
    if not any(map(len, samples)):
        axes.set_xticks([])
