"""The polygon files that are read: help, messages and the table of ``docs/polygons.md`` come from here.

A new format is a file beside this one with ``drawing_of_file(path, reading)``, and an entry below.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Format:
    """One format.

    Attributes:
        name: what people call it.
        suffixes: of its files, in lower case.
        module: the file in this folder that reads it, imported when it is needed.
        meaning: what of it is read, in one line of Markdown.
        most_bytes: of a file at most: a hundred for each vertex, fewer where each takes more time and memory, more
            where most of them are of no outline.
    """

    name: str
    suffixes: tuple[str, ...]
    module: str
    meaning: str
    most_bytes: int = 100_000_000


FORMATS = (
    Format(
        "JSON", (".geojson", ".json"), "json_text",
        'GeoJSON polygons, with the lines, points and names of Features; `{"rings": [outer, hole, ...]}`; '
        "a list of `[x, y]`",
    ),
    Format("WKT", (".wkt",), "wkt", "POLYGON, MULTIPOLYGON, or a GEOMETRYCOLLECTION of these with lines and points"),
    Format("text", (".txt",), "plain_text", "a table when it begins with a number, otherwise WKT"),
    Format(
        "table", (".csv", ".tsv", ".xy", ".dat"), "table",
        "rows `x y` separated by comma, semicolon, tab or spaces, with or without a header; a blank line or a third "
        "column `ring` separates rings, a column `name` names sides",
    ),
    Format(
        "DXF", (".dxf",), "dxf",
        "LINE, LWPOLYLINE, POLYLINE (with bulges), ARC, CIRCLE, ELLIPSE, SPLINE, also in inserted blocks, on the "
        "layers asked for, or those that are neither off nor frozen",
        most_bytes=20_000_000,
    ),
    Format(
        "SVG", (".svg",), "svg",
        "`path`, `rect`, `circle`, `ellipse`, `polygon`, `polyline`, `line`, in groups, with transforms, used again; "
        "what is not displayed is left out",
        most_bytes=20_000_000,
    ),
    Format(
        "STEP", (".step", ".stp"), "step",
        "the faces of a file without solids that lie in one plane; needs Gmsh (`pip install gmsh`)",
        most_bytes=20_000_000,
    ),
    Format(
        "Gmsh script", (".geo",), "geo",
        "points, lines, circle and ellipse arcs, splines, loops, plane surfaces, transfinite curves, variables and "
        "expressions",
        most_bytes=20_000_000,
    ),
    Format(
        "Gmsh mesh", (".msh",), "msh",
        "versions 2.2 and 4.1, ASCII or binary: the outline of each surface, or the loops of line elements",
        most_bytes=200_000_000,
    ),
)  # fmt: skip

#: The format of each suffix.
BY_SUFFIX = {suffix: format for format in FORMATS for suffix in format.suffixes}
