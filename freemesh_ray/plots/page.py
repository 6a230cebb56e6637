"""The page that a picture is drawn on, and how it gets into a file."""

from __future__ import annotations

from pathlib import Path

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, SubFigure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from freemesh_ray.storage.atomic import replacing

DPI, WIDTH, MARGIN = 160, 7.0, 0.1  # inches
#: Kinds of picture.
SUFFIXES = (".png", ".svg")


def page(width: float, height: float) -> Figure:
    """An empty figure of so many inches."""
    figure = Figure(figsize=(width, height), dpi=DPI, layout=ConstrainedLayoutEngine(w_pad=MARGIN, h_pad=MARGIN))
    FigureCanvasAgg(figure)
    return figure


def save(figure: Figure | SubFigure, path: str | Path) -> None:
    """Write the picture; the same picture gives the same bytes.

    Raises:
        OutputError: the place cannot be written to.
    """
    path = Path(path)
    root = figure.figure if isinstance(figure, SubFigure) else figure
    svg = path.suffix.lower() == ".svg"
    with matplotlib.rc_context({"svg.hashsalt": "freemesh"}), replacing(path) as draft:
        root.savefig(draft, metadata={"Date": None} if svg else {"Software": None}, facecolor="white")
