"""The page that a picture is drawn on, and how it gets into a file."""

from __future__ import annotations

import io
from pathlib import Path

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, SubFigure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.text import Text

from envs.printable import printable
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
    _show_as_is(root)
    with matplotlib.rc_context({"svg.hashsalt": "freemesh", "text.parse_math": False}), replacing(path) as draft:
        root.savefig(draft, metadata={"Date": None} if svg else {"Software": None}, facecolor="white")


def png_of(figure: Figure | SubFigure) -> bytes:
    """The picture as a PNG's bytes, 100 dots an inch."""
    root = figure.figure if isinstance(figure, SubFigure) else figure
    draft = io.BytesIO()
    _show_as_is(root)
    with matplotlib.rc_context({"text.parse_math": False}):
        root.savefig(draft, format="png", dpi=100, bbox_inches="tight", facecolor="white")
    return draft.getvalue()


def _show_as_is(figure: Figure) -> None:
    """Make every text of a figure stand for itself: no formulas in names (``$``), and nothing that XML cannot hold."""
    for text in figure.findobj(Text):
        text.set_parse_math(False)
        text.set_text(as_is(text.get_text()))


def as_is(text: str) -> str:
    """Text as it may stand in a picture; for labels of ticks, which are made when it is drawn."""
    return "\n".join(printable(line) for line in text.split("\n"))
