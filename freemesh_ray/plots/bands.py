"""Lines in their bands, panel by panel, one key for all: learning curves of several seeds, performance profiles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import EngFormatter

from envs.types import Floats
from freemesh_ray.plots.page import WIDTH, page, save
from freemesh_ray.plots.series import MUTED, colour, key, key_rows, line, plain
from freemesh_ray.statistics.bootstrap import Interval

PANEL_WIDTH, HEIGHT = 5.2, 4.3  # inches
#: Beyond so many points a line is smooth to the eye without marks.
FEW_POINTS = 4


class Panel(NamedTuple):
    """One axes.

    Attributes:
        bands: label -> x (t,) and its values with their interval, (t,) each; the same labels in every panel, t may
            be 0.
        xlabel, ylabel: of the axes.
        low, high: ends of the vertical scale; None: as the values are.
    stepped: whether values hold from their x up to the next, in place of changing evenly.
    """

    bands: Mapping[str, tuple[Floats, Interval]]
    xlabel: str
    ylabel: str
    low: float | None = None
    high: float | None = None
    stepped: bool = False


def draw_bands(panels: Sequence[Panel], path: str | Path, title: str | None = None, note: str = "") -> Figure:
    """Draw one line a label in its band, in every panel.

    Args:
        panels: side by side, at least one.
        path: PNG or SVG to write.
        title: above all.
        note: below all, small: what the lines and bands are.

    Raises:
        OutputError: the place cannot be written to.
    """
    labels = list(panels[0].bands)
    figure = page(max(PANEL_WIDTH * len(panels), WIDTH), HEIGHT + 0.25 * (key_rows(len(labels)) - 1))
    for axes, panel in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        _draw_panel(axes, panel)
    if note:
        figure.supxlabel(note, color=MUTED, fontsize=8)
    key(figure, [Line2D([], [], label=label, **line(i)) for i, label in enumerate(labels)], title)
    save(figure, path)
    return figure


def _draw_panel(axes: Axes, panel: Panel) -> None:
    for i, (x, band) in enumerate(panel.bands.values()):
        if not len(x):
            continue
        step: Literal["post"] | None = "post" if panel.stepped else None
        axes.fill_between(x, band.low, band.high, step=step, color=colour(i), alpha=0.16, linewidth=0)
        drawn = "steps-post" if panel.stepped else "default"
        axes.plot(x, band.value, marker="o" if len(x) < FEW_POINTS else "", markersize=4, drawstyle=drawn, **line(i))
    axes.set_xlabel(panel.xlabel)
    axes.set_ylabel(panel.ylabel)
    axes.set_ylim(panel.low, panel.high)
    axes.margins(x=0.01)
    if any(len(x) and x[-1] >= 1000 for x, _ in panel.bands.values()):
        axes.xaxis.set_major_formatter(EngFormatter(sep=""))
    plain(axes)
    if not any(len(x) for x, _ in panel.bands.values()):
        axes.text(0.5, 0.5, "no evaluation yet", transform=axes.transAxes, ha="center", color=MUTED)
