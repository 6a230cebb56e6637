"""Speed against the number of env runners: measured here, modelled here and beyond."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from freemesh_ray.plots.colours import INK
from freemesh_ray.plots.page import WIDTH, page, save
from freemesh_ray.plots.series import colour, line, plain

Points = list[tuple[float, float]]


class Here(NamedTuple):
    """Of some settings on this machine, points (runners, samples a second).

    Attributes:
        overlapping, waiting: measured, with and without overlap.
        modelled: with overlap.
    """

    overlapping: Points
    waiting: Points
    modelled: Points


def draw_scaling(here: Mapping[str, Here], beyond: Mapping[str, Points], path: str | Path) -> Figure:
    """Draw two panels: this machine, and one with a core for every process.

    Args:
        here: label -> what was measured, and what the model says of the same.
        beyond: label -> what the model says, points (runners, samples a second).
        path: PNG or SVG to write.
    """
    figure = page(WIDTH, 4.8)
    left, right = figure.subplots(1, 2)
    for i, (label, points) in enumerate(here.items()):
        dots = {"color": colour(i), "linestyle": "", "marker": "o", "markersize": 6}
        left.plot(*np.array(points.overlapping).T, **dots, label=label)
        left.plot(*np.array(points.waiting).T, **dots, fillstyle="none")
        left.plot(*np.array(points.modelled).T, color=colour(i), linestyle="--", linewidth=1.2)
    left.set_title("measured here (rings: no overlap),\nand the model (dashed)", color=INK, fontsize=9)
    left.set_xscale("symlog", base=2, linthresh=2)
    left.set_xticks(sorted({runners for points in here.values() for runners, _ in points.overlapping}))
    for i, (label, modelled) in enumerate(beyond.items()):
        right.plot(*np.array(modelled).T, **line(i), label=label)
    right.set_title("the model, a core for every process", color=INK, fontsize=9)
    right.set_xscale("log", base=2)
    for axes in (left, right):
        axes.set_yscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_major_formatter("{x:,.0f}")
        axes.yaxis.set_minor_formatter("")
        axes.set_xlabel("env runners")
        axes.set_ylabel("samples a second")
        plain(axes)
        axes.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.18))
    save(figure, path)
    return figure
