"""A search's trials: their scores against each setting that was searched."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from envs.types import Floats
from freemesh_ray.plots.colours import SERIES
from freemesh_ray.plots.page import as_is, page, save
from freemesh_ray.plots.series import key, plain

COLUMNS = 3
#: Positive values that span more than this factor are shown on a logarithmic scale.
WIDE = 20.0
DEFAULT, BEST, TRIAL = SERIES[1], SERIES[2], SERIES[0]


def draw_settings(
    settings: Mapping[str, Sequence[Any]],
    scores: Floats,
    path: str | Path,
    ylabel: str,
    default: int | None = None,
    title: str | None = None,
) -> Figure:
    """Draw a panel for each setting: a dot a trial, the best and the default marked.

    Args:
        settings: name -> value of each trial; numbers, or anything else, which then stands in the order of its text.
        scores: (n,) of each trial, higher is better, at least one of them finite.
        path: PNG or SVG to write.
        ylabel: what the scores are.
        default: place of the trial with the default settings.
        title: above all.

    Raises:
        OutputError: the place cannot be written to.
    """
    columns = min(COLUMNS, len(settings))
    rows = math.ceil(len(settings) / columns)
    figure = page(max(3.3 * columns, 5.0), 2.7 * rows + 0.8)
    panels = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel().tolist()
    best = int(np.nanargmax(scores))
    for axes, (name, values) in zip(panels, settings.items(), strict=False):
        places = _scale(axes, values)
        axes.scatter(places, scores, s=26, color=TRIAL, alpha=0.55, linewidths=0)
        axes.scatter(places[best], scores[best], s=130, color=BEST, marker="*", zorder=3)
        if default is not None:
            axes.scatter(places[default], scores[default], s=60, facecolor="none", edgecolor=DEFAULT, linewidths=2,
                         marker="D", zorder=3)  # fmt: skip
        axes.set_xlabel(name)
        plain(axes)
    for axes in panels[len(settings) :]:
        axes.remove()
    figure.supylabel(ylabel, fontsize=10)
    marks = [_mark("o", TRIAL, "trial", 6), _mark("*", BEST, "best", 12)]
    if default is not None:
        hollow = Line2D([], [], linestyle="", marker="D", markerfacecolor="none", markeredgecolor=DEFAULT)
        hollow.set(markeredgewidth=2, label="default")
        marks.append(hollow)
    key(figure, marks, title)
    save(figure, path)
    return figure


def _mark(marker: str, colour: str, label: str, size: float) -> Line2D:
    return Line2D([], [], linestyle="", marker=marker, color=colour, markersize=size, markeredgewidth=0, label=label)


def _scale(axes: Axes, values: Sequence[Any]) -> Floats:
    """(n,) places of the values on the axis, which is made to fit them."""
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        places = np.array(values, dtype=np.float64)
        if places.min() > 0 and places.max() > WIDE * places.min():
            axes.set_xscale("log")
        return places
    words = sorted({str(value) for value in values})
    axes.set_xticks(range(len(words)), list(map(as_is, words)))
    axes.set_xlim(-0.5, len(words) - 0.5)
    return np.array([words.index(str(value)) for value in values], dtype=np.float64)
