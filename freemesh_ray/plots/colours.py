"""The colours of every picture: element quality on one scale, so that pictures compare, and what stands out from it."""

from __future__ import annotations

from matplotlib import colormaps
from matplotlib.colors import Normalize, to_hex

#: Element quality in [0, 1] is drawn on this scale.
QUALITY, COLOURS = Normalize(0.0, 1.0), "viridis"
#: Text and the given boundary; the front, where elements are still missing.
INK, FRONT = "#1a1a1a", "#c0392b"
#: Triangles, which have no quality.
TRIANGLE = "#d62728"
#: Interior nodes of fewer than four edges, and of more.
FEW, MANY = "#ff7f0e", "#e3208f"
#: Series side by side (Okabe and Ito: told apart by colour-blind eyes too).
SERIES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#1a1a1a")


def scale(steps: int) -> list[str]:
    """The quality scale as ``steps`` colours ``#rrggbb``, from quality 0 to 1."""
    return [to_hex(colour) for colour in colormaps[COLOURS].resampled(steps)(range(steps))]
