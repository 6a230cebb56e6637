"""Pairs of variants: how likely a run of one beats a run of the other, with intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter

from freemesh_ray.plots.colours import INK
from freemesh_ray.plots.page import WIDTH, as_is, page, save
from freemesh_ray.plots.series import MUTED, key, plain
from freemesh_ray.statistics.bootstrap import Interval

#: By what pairs are compared; no colours, which stand for variants elsewhere.
SHADES, MARKS = (INK, "#8a8a8a"), "oD"


class Pair(NamedTuple):
    """X against Y.

    Attributes:
        x, y: labels.
        intervals: by what they are compared -> P(X > Y); one or two, the same for all pairs.
    """

    x: str
    y: str
    intervals: Mapping[str, Interval]


def draw_improvements(pairs: Sequence[Pair], path: str | Path, title: str | None = None) -> Figure:
    """Draw P(X > Y) of every pair: a mark in its interval, X to the left and Y to the right of its row.

    Args:
        pairs: from the top down, at least one.
        path: PNG or SVG to write.
        title: above all.

    Raises:
        OutputError: the place cannot be written to.
    """
    kinds = list(dict.fromkeys(by for pair in pairs for by in pair.intervals))
    marks: list[Line2D] = []
    figure = page(WIDTH, 1.7 + 0.22 * len(pairs) * max(len(kinds), 1.6))
    axes = figure.add_subplot()
    axes.axvline(0.5, color=MUTED, linewidth=1.0, linestyle=(0, (4, 3)))
    for i, by in enumerate(kinds):
        rows = [(row, pair.intervals[by]) for row, pair in enumerate(pairs) if by in pair.intervals]
        places = [row + 0.3 * (i - 0.5 * (len(kinds) - 1)) for row, _ in rows]
        axes.hlines(places, [band.low for _, band in rows], [band.high for _, band in rows],
                    color=SHADES[i], alpha=0.35, linewidth=6)  # fmt: skip
        marks += axes.plot([band.value for _, band in rows], places, MARKS[i], color=SHADES[i], markersize=5, label=by)
    axes.set_xlim(-0.02, 1.02)
    axes.set_ylim(len(pairs) - 0.4, -0.6)
    axes.set_yticks(range(len(pairs)), [as_is(pair.x) for pair in pairs])
    axes.set_xlabel("probability that a run of X (left) beats a run of Y (right)")
    axes.xaxis.set_major_formatter(PercentFormatter(1.0))
    plain(axes)
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)
    right = axes.secondary_yaxis("right")
    right.set_yticks(range(len(pairs)), [as_is(pair.y) for pair in pairs])
    right.tick_params(length=0)
    right.spines["right"].set_visible(False)
    axes.spines["left"].set_visible(False)
    key(figure, marks, title)
    save(figure, path)
    return figure
