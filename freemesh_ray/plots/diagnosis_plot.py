"""The picture of what is wrong with an outline: the rings, a numbered mark at each place, and the list below."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from envs.polygons.diagnosis import Problem
from envs.types import Floats
from freemesh_ray.plots.colours import INK, SERIES
from freemesh_ray.plots.page import DPI, WIDTH, page, save

#: The colour of each kind of problem.
COLOURS = {
    "crossing": "#c0392b", "spike": SERIES[1], "repeated point": SERIES[3], "overlap": SERIES[0], "gap": SERIES[4],
    "too coarse": SERIES[2], "outline": "#c0392b",
}  # fmt: skip

#: Marks that are drawn, and listed, at most.
SHOWN = 40

#: Characters of a line of the list, and the height of one (inches).
COLUMNS, LINE = 108, 0.165

#: Marks keep this distance (points) from each other.
APART = 15.0


def draw_diagnosis(
    title: str, lines: Sequence[Floats], found: Sequence[Problem], path: str | Path, *, sound: str = "nothing is wrong"
) -> None:
    """Draw rings and what is wrong with them.

    Args:
        title: above the picture.
        lines: polylines, each (k, 2); a ring ends where it begins.
        found: numbered from 1.
        path: PNG or SVG to write.
        sound: what the picture says where nothing is wrong.

    Raises:
        OutputError: the place cannot be written to.
    """
    shown = list(found)[:SHOWN]
    text = listed(shown, len(found)) or [sound]
    points = np.concatenate([*lines, *[np.array([[one.x, one.y]]) for one in shown], np.zeros((0, 2))])
    points = points if len(points) else np.zeros((1, 2))
    low, span = points.min(axis=0), np.ptp(points, axis=0)
    span = np.maximum(span, 0.05 * max(float(span.max()), 1e-300))
    height = float(np.clip(WIDTH * span[1] / span[0], 1.8, 8.0))
    below = LINE * len(text) + 0.25
    figure = page(WIDTH, height + below + 0.4)
    figure.set_layout_engine("none")
    whole = height + below + 0.4
    axes = figure.add_axes((0.03, below / whole, 0.94, height / whole))
    axes.set_aspect("equal")
    axes.set_axis_off()
    middle = low + 0.5 * np.ptp(points, axis=0)
    half = 0.5 * span * 1.16
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
    axes.add_collection(LineCollection(list(lines), colors=INK, linewidths=0.9))
    for one in shown:
        if len(one.lines):
            axes.add_collection(LineCollection(list(one.lines), colors=COLOURS[one.kind], linewidths=2.0, alpha=0.55))
    mark(axes, shown)
    figure.text(0.03, 1.0 - 0.12 / whole, title, va="top", color=INK, fontsize=11, fontweight="bold")
    for k, line in enumerate(text):
        figure.text(0.03, (below - 0.05 - LINE * k) / whole, line, va="top", color=INK, fontsize=7.2,
                    family="monospace")  # fmt: skip
    save(figure, path)


def listed(shown: Sequence[Problem], count: int) -> list[str]:
    """The lines of the list."""
    lines = []
    for k, one in enumerate(shown, 1):
        text = f"{one.kind} at {one.place}: {one.told}; {one.fix}"
        lines += wrap(text, COLUMNS, initial_indent=f"{k:>3} ", subsequent_indent="    ", break_long_words=True)
    if count > len(shown):
        lines.append(f"    and {count - len(shown)} more")
    return lines


def mark(axes: Axes, shown: Sequence[Problem]) -> None:
    """A ring at each place, and its number beside it, none upon another."""
    scale = DPI / 72.0
    axes.apply_aspect()
    at = axes.transData.transform([(one.x, one.y) for one in shown]) / scale if shown else np.zeros((0, 2))
    box = np.asarray(axes.get_window_extent().extents, dtype=np.float64) / scale
    centre = np.array([(box[0] + box[2]) / 2, (box[1] + box[3]) / 2])
    taken: list[Floats] = []
    for k, (one, place) in enumerate(zip(shown, at, strict=True), 1):
        colour = COLOURS[one.kind]
        axes.plot([one.x], [one.y], marker="o", markersize=7, markerfacecolor="none", markeredgecolor=colour,
                  markeredgewidth=1.4, zorder=5)  # fmt: skip
        spot = free_spot(place, [*taken, *at], box, place - centre)
        taken.append(spot)
        axes.annotate(
            str(k), (one.x, one.y), tuple(spot - place), textcoords="offset points", ha="center", va="center",
            fontsize=8, fontweight="bold", color="white", zorder=6, annotation_clip=False,
            bbox={"boxstyle": "circle,pad=0.22", "facecolor": colour, "edgecolor": "none"},
            arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.7, "shrinkA": 0, "shrinkB": 3},
        )  # fmt: skip


def free_spot(place: Floats, taken: Sequence[Floats], box: Floats, away: Floats) -> Floats:
    """Where a number goes: the nearest place around its mark that keeps clear of what is there, outwards first."""
    first = np.arctan2(away[1], away[0])
    others = np.array(taken).reshape(-1, 2)
    best, room = place + APART, -np.inf
    for radius in np.arange(1.0, 12.0) * APART:
        for turn in np.concatenate([[0.0], np.repeat(np.arange(1, 9), 2) * np.tile([1.0, -1.0], 8)]) * np.pi / 8:
            spot = place + radius * np.array([np.cos(first + turn), np.sin(first + turn)])
            if (spot < box[:2] + 6.0).any() or (spot > box[2:] - 6.0).any():
                continue
            clear = np.linalg.norm(others - spot, axis=1).min(initial=np.inf)
            if clear >= 0.9 * APART:
                return spot
            if clear > room:
                best, room = spot, clear
    return best
