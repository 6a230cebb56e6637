"""Speed against the number of env runners: measured here, modelled here and beyond."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from freemesh_ray.plots.colours import INK
from freemesh_ray.plots.page import WIDTH, page, save
from freemesh_ray.plots.series import colour, line, plain

Points = Sequence[tuple[float, float]]


def draw_scaling(here: Mapping[str, tuple[Points, Points]], beyond: Mapping[str, Points], path: str | Path) -> Figure:
    """Draw two panels: this machine, and one with a core for every process.

    Args:
        here: label -> what was measured and what the model says of the same, points (runners, samples a second).
        beyond: label -> what the model says.
        path: PNG or SVG to write.
    """
    figure = page(WIDTH, 4.8)
    left, right = figure.subplots(1, 2)
    for i, (label, (measured, modelled)) in enumerate(here.items()):
        left.plot(*np.array(measured).T, color=colour(i), linestyle="", marker="o", markersize=6, label=label)
        left.plot(*np.array(modelled).T, color=colour(i), linestyle="--", linewidth=1.2)
    left.set_title("measured here, and the model (dashed)", color=INK, fontsize=11)
    left.set_ylim(bottom=0)
    for i, (label, points) in enumerate(beyond.items()):
        right.plot(*np.array(points).T, **line(i), label=label)
    right.set_title("the model, a core for every process", color=INK, fontsize=11)
    right.set_yscale("log")
    for axes in (left, right):
        axes.set_xscale("log", base=2)
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlabel("env runners")
        axes.set_ylabel("samples a second")
        plain(axes)
        axes.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.18))
    save(figure, path)
    return figure
