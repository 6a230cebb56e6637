"""Box plots that compare meshers: a panel for each metric, a box for each mesher."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from envs.types import Floats
from freemesh_ray.plots.colours import INK, SERIES
from freemesh_ray.plots.page import as_is, page, save

#: Which way is better.
HIGHER, LOWER = "↑ higher is better", "↓ lower is better"


class Metric(NamedTuple):
    """How a metric is shown.

    Attributes:
        title: above its panel.
        better: HIGHER or LOWER.
        of: what has one value of it, an element or a mesh.
        low, high: the ends of the scale at most; values beyond them are counted, not drawn.
    """

    title: str
    better: str
    of: str
    low: float = 0.0
    high: float = math.inf


#: Metrics by their names in freemesh_ray.mesh_geometry.metrics.
METRICS: dict[str, Metric] = {
    "singularity": Metric("irregular nodes", LOWER, "mesh"),
    "singularity_authors": Metric("singularity", LOWER, "mesh"),
    "eta": Metric("element quality η", HIGHER, "element", 0.0, 1.0),
    "min_angle": Metric("|least angle − 90°|", LOWER, "element", 0.0, 90.0),
    "min_angle_authors": Metric("least |angle − 90°|", LOWER, "element", 0.0, 90.0),
    "max_angle": Metric("|largest angle − 90°|", LOWER, "element", 0.0, 90.0),
    "max_angle_authors": Metric("largest |angle − 90°|", LOWER, "element", 0.0, 90.0),
    "scaled_jacobian": Metric("scaled Jacobian", HIGHER, "element", 0.0, 1.0),
    "stretch": Metric("stretch", HIGHER, "element", 0.0, 1.0),
    "taper": Metric("taper", LOWER, "element", 0.0, 2.0),
    "taper_paper": Metric("taper by triangles", LOWER, "element", 0.0, 1.0),
    "triangles": Metric("triangles", LOWER, "mesh"),
}
#: The panels of the paper's figure, whose values are by the authors' definitions.
PANELS = (
    "singularity_authors", "eta", "min_angle_authors", "max_angle_authors",
    "scaled_jacobian", "stretch", "taper", "triangles",
)  # fmt: skip
COLUMNS = 4
KEY = "box: quartiles, line: median, diamond: mean, whiskers: last value within 1.5 box lengths, dots: values"
#: Up to so many values are drawn as dots, too.
FEW_VALUES = 20


def draw_boxes(
    values: Mapping[str, Mapping[str, Floats]],
    path: str | Path,
    metrics: Sequence[str] = PANELS,
    title: str | None = None,
) -> Figure:
    """Draw the distribution of each metric's values for each mesher.

    A box reaches from the first to the third quartile, the line in it is the median, the diamond the mean; whiskers end
    at the last value within 1.5 box lengths, values beyond them are dots.

    Args:
        values: metric, a key of `METRICS` -> mesher -> its values, (k,); the same meshers in the same order for every
            metric. Values that are not finite are left out.
        path: PNG or SVG to write.
        metrics: the panels in order, at least one.
        title: above all.

    Raises:
        OutputError: the place cannot be written to.
        ValueError: no metric.
    """
    if not metrics:
        raise ValueError("draw_boxes: no metrics: name at least one")
    columns = min(COLUMNS, len(metrics))
    rows = math.ceil(len(metrics) / columns)
    meshers = list(values[metrics[0]])
    figure = page(columns * (1.3 + 0.42 * max(len(meshers), 3)), rows * 2.9 + (1.2 if title else 0.8))
    panels = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    for i, (axes, metric) in enumerate(zip(panels, metrics, strict=False)):
        _draw_metric(axes, METRICS[metric], [each[np.isfinite(each)] for each in values[metric].values()])
        names = meshers if i + columns >= len(metrics) else []  # below the lowest panels
        axes.set_xticks(range(len(names)), list(map(as_is, names)), rotation=35, ha="right", rotation_mode="anchor")
    figure.supxlabel(KEY, color="#666666", fontsize=8)
    for axes in panels[len(metrics) :]:
        axes.remove()
    if title is not None:
        figure.suptitle(title, color=INK, fontsize=13, fontweight="bold")
    save(figure, path)
    return figure


def _draw_metric(axes: Axes, metric: Metric, samples: Sequence[Floats]) -> None:
    off_scale = 0
    for place, values in enumerate(samples):
        if not len(values):
            continue
        colour = SERIES[place % len(SERIES)]
        shown = values[(values >= metric.low) & (values <= metric.high)]
        off_scale += len(values) - len(shown)
        axes.boxplot(
            values, positions=[place], widths=0.6, patch_artist=True, showmeans=True, manage_ticks=False,
            showfliers=len(values) > FEW_VALUES,
            boxprops={"facecolor": f"{colour}40", "edgecolor": colour},
            whiskerprops={"color": colour}, capprops={"color": colour},
            medianprops={"color": colour, "linewidth": 2},
            meanprops={"marker": "D", "markersize": 4, "markerfacecolor": "white", "markeredgecolor": colour},
            flierprops={"marker": ".", "markersize": 3, "markerfacecolor": colour, "markeredgewidth": 0, "alpha": 0.5},
        )  # fmt: skip
        if len(values) <= FEW_VALUES:
            # On a few places in turn, so that equal values do not hide each other.
            lanes = max(min(len(shown), 5), 1)
            spread = place + 0.08 * (np.arange(len(shown)) % lanes - 0.5 * (lanes - 1))
            axes.scatter(spread, shown, s=9, color=colour, alpha=0.7, linewidths=0, zorder=3)
    _set_scale(axes, metric, np.concatenate([np.empty(0), *samples]))
    axes.set_xlim(-0.6, len(samples) - 0.4)
    axes.set_title(metric.title, color=INK, fontsize=11, fontweight="bold", pad=18)
    note = f"each {metric.of} · {metric.better}" + (f" · {off_scale:,} off scale" if off_scale else "")
    axes.annotate(
        note, (0.5, 1.0), (0, 5), xycoords="axes fraction", textcoords="offset points", ha="center", color="#666666",
        fontsize=8,
    )  # fmt: skip
    axes.grid(axis="y", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "bottom"]].set_visible(False)
    axes.tick_params(axis="x", length=0)
    axes.tick_params(axis="y", labelsize=8)


def _set_scale(axes: Axes, metric: Metric, values: Floats) -> None:
    """From the least to the largest value on the metric's scale, and a little more."""
    shown = values[(values >= metric.low) & (values <= metric.high)]
    if not len(shown):
        axes.set_yticks([])
        return
    low, high = shown.min(), shown.max()
    margin = 0.04 * (high - low) if high > low else 0.5
    axes.set_ylim(low - margin, high + margin)
    axes.yaxis.set_major_locator(MaxNLocator(6, integer=metric.of == "mesh"))
