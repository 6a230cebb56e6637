"""Learning curves, one line or band for each series."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter

from freemesh_ray.plots.colours import INK, SERIES
from freemesh_ray.plots.page import WIDTH, page, save
from freemesh_ray.statistics.aligned_curves import Curve, aligned


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
    figure = page(WIDTH, 4.2)
    axes = figure.add_subplot()
    for i, (label, curves) in enumerate(series.items()):
        colour = SERIES[i % len(SERIES)]
        steps, values = aligned([curves] if isinstance(curves, tuple) else curves)
        if not len(steps):
            continue
        name = label if len(values) == 1 else f"{label} (mean of {len(values)} seeds)"
        if len(values) > 1:
            axes.fill_between(steps, values.min(axis=0), values.max(axis=0), color=colour, alpha=0.18, linewidth=0)
        axes.plot(steps, values.mean(axis=0), color=colour, linewidth=1.8, label=name)
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)
    axes.set_title(title or "", color=INK, fontsize=12, fontweight="bold")
    axes.xaxis.set_major_formatter(EngFormatter(sep=""))
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0.01)
    if axes.has_data():
        axes.legend(frameon=False, loc="best")
    save(figure, path)
    return figure
