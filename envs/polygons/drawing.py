"""What a file or a program states of a geometry: polygons, and the names, curves, lines and points that go with them.

::

    +------- top --------+      polygons   "steel" and "copper", which share the side between them
    |         |          |      lines      "top", along the boundary: a name for the segments on it
    |  steel  |  copper  |                 "crack", inside: elements follow it
    |   ---crack         |      points     "gauge", inside: a node sits on it
    |         |    x     |
    +---------+----------+      Lines lie along the sides or inside; which of the two, their place says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from envs.types import Curve, Floats


@dataclass(frozen=True, eq=False)
class Line:
    """A polyline beside the polygons.

    Attributes:
        points: (k, 2) float64, k >= 2, from its start to its end; closed when the two are equal.
        name: of the boundary segments, or of the edges inside, that lie on it; empty: no name.
        curve: what the polyline was flattened from; None: it is straight between its points.
        crack: inside, its two sides are apart: nodes on it come twice.
        optional: it names what lies on it and is otherwise passed over, as a drawing's centre lines are.
    """

    points: Floats
    name: str = ""
    curve: Curve | None = None
    crack: bool = False
    optional: bool = False


@dataclass(frozen=True)
class Place:
    """A point inside a polygon that a node is to sit on, or one of its boundary that gets a name."""

    x: float
    y: float
    name: str = ""


@dataclass(frozen=True)
class Drawing:
    """A geometry as it was stated; nothing is checked yet.

    Attributes:
        polygons: for each its rings, the outer one first, each (n, 2) numbers.
        regions: the name of each polygon, such as its material; empty: none of them has one.
        lines: see `Line`.
        places: see `Place`.
        notes: what was read in another way than it was drawn, a line each, for the user.
    """

    polygons: Sequence[Sequence[Any]]
    regions: Sequence[str] = ()
    lines: Sequence[Line] = ()
    places: Sequence[Place] = ()
    notes: Sequence[str] = ()


@dataclass(frozen=True)
class Reading:
    """How a file is read.

    Attributes:
        edge_length: what outlines are to be split by afterwards, which curves are flattened for; None: for good.
        layers: those of a drawing that are read, by name; empty: all that are seen.
        join: how far apart ends may lie that meet, in the file's units; None: what the format's rounding explains.
    """

    edge_length: float | None = None
    layers: tuple[str, ...] = ()
    join: float | None = None
