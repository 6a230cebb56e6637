"""How series are told apart: the same place in the order, the same colour and line in every picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from freemesh_ray.plots.colours import INK, SERIES

#: Beyond the last colour the colours begin anew with the next line.
LINES = ("-", "--", ":", "-.")
GRID, MUTED = "#dddddd", "#666666"

#: Entries of a key side by side at most.
KEY_COLUMNS = 6


def key_rows(entries: int) -> int:
    """Rows that a key of so many entries takes."""
    return -(-entries // KEY_COLUMNS)


def colour(place: int) -> str:
    """The colour of the series in that place of the order."""
    return SERIES[place % len(SERIES)]


def line(place: int) -> dict[str, Any]:
    """How its line is drawn."""
    return {"color": colour(place), "linestyle": LINES[place // len(SERIES) % len(LINES)], "linewidth": 1.8}


def plain(axes: Axes) -> None:
    """A grid behind the values, no frame above and to the right."""
    axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def key(figure: Figure, handles: Sequence[Line2D], title: str | None) -> None:
    """One key above all panels, below the title, to be read row by row."""
    columns = -(-len(handles) // key_rows(len(handles)))
    ordered = [handle for column in range(columns) for handle in handles[column::columns]]  # filled column by column
    legend = figure.legend(
        handles=ordered, loc="outside upper center", ncols=columns, frameon=False, title=title,
        title_fontproperties={"weight": "bold", "size": 13},
    )  # fmt: skip
    legend.get_title().set_color(INK)
