"""A mesh as a small SVG with its label and figures: a few bytes an element, sharp at any size, for a page of many."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np

from envs.mesh import Mesh
from envs.printable import printable
from envs.quality import element_quality
from envs.types import Floats, Ints
from freemesh_ray.mesh_geometry.metrics import irregular
from freemesh_ray.plots import caption
from freemesh_ray.plots.colours import FEW, FRONT, INK, MANY, scale
from freemesh_ray.plots.mesh_plot import front
from freemesh_ray.storage.atomic import replacing

#: Width of the picture and of its margins, height of the text above the mesh, in pixels; the height of a mesh at most.
WIDTH, MARGIN, TEXT, TALLEST = 320, 10, 66, 480
#: Coordinates are whole numbers of this part of a pixel.
UNIT = 0.05
#: Width of the lines of the boundary and of the front, in pixels.
BOLD = 1.5
#: Colours of the quality scale.
SHADES = 64
#: Letters of the label that fit into a line.
LETTERS = 34


def write(path: Path, mesh: Mesh, label: str) -> None:
    """Write a mesh, elements coloured by quality, its front in red where it is not complete; the same bytes every time.

    Raises:
        OutputError: the place cannot be written to.
    """
    with replacing(path) as draft:
        draft.write_text(svg(mesh, label), encoding="utf-8")


def svg(mesh: Mesh, label: str) -> str:
    """The picture's text; the label may be of any origin."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    width, height = np.maximum(high - low, 1e-300).tolist()
    pixel = min((WIDTH - 2 * MARGIN) / width, TALLEST / height)
    left, bottom = (WIDTH - pixel * width) / 2, TEXT + pixel * height
    points = np.rint((np.array([left, bottom]) + (mesh.vertices - low) * [pixel, -pixel]) / UNIT).astype(np.int64)
    fine = float(np.clip(8.0 / np.sqrt(len(mesh.quads) + 1.0), 0.1, 0.7)) / UNIT
    dot = float(np.clip(70.0 / np.sqrt(len(mesh.quads) + 1.0), 1.5, 6.0)) / UNIT
    figures = [escape(line) for line in caption(mesh).split("\n")]
    name = escape(printable(label))
    first = name if len(label) <= LETTERS else escape(printable(label[: LETTERS - 1])) + "…"
    total = round(bottom + MARGIN)
    nodes, valence = irregular(mesh), mesh.valence
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{total}" viewBox="0 0 {WIDTH} {total}">',
        f"<title>{name}</title>",
        f'<rect width="{WIDTH}" height="{total}" fill="white"/>',
        f'<g text-anchor="middle" font-family="system-ui, sans-serif" font-size="12" fill="{INK}">',
        f'<text x="{WIDTH // 2}" y="20" font-size="15" font-weight="bold">{first}</text>',
        *(f'<text x="{WIDTH // 2}" y="{38 + 16 * i}">{line}</text>' for i, line in enumerate(figures)),
        "</g>",
        f'<g transform="scale({UNIT})" stroke-linejoin="round" fill="none">',
        f'<g stroke="white" stroke-width="{fine:.0f}">',
        *_elements(mesh, points),
        "</g>",
        "" if mesh.complete else _lines(points[front(mesh)], FRONT),
        _lines(points[mesh.segments], INK),
        _dots(points[nodes[valence[nodes] < 4]], FEW, dot, "round"),
        _dots(points[nodes[valence[nodes] > 4]], MANY, 0.8 * dot, "square"),
        "</g>",
        "</svg>",
    ]
    return "\n".join(line for line in lines if line) + "\n"


def _elements(mesh: Mesh, points: Ints) -> Iterable[str]:
    """One path for all elements of a shade."""
    if not len(mesh.quads):
        return
    quality: Floats = element_quality(mesh.vertices, mesh.quads)
    shades = np.clip((quality * SHADES).astype(np.int64), 0, SHADES - 1)
    colours = scale(SHADES)
    for shade in np.unique(shades).tolist():
        corners = points[mesh.quads[shades == shade]].reshape(-1, 8).tolist()
        path = "".join(f"M{a} {b}L{c} {d} {e} {f} {g} {h}Z" for a, b, c, d, e, f, g, h in corners)
        yield f'<path fill="{colours[shade]}" d="{path}"/>'


def _lines(ends: Ints, colour: str) -> str:
    """(n, 2, 2) pairs of points: straight lines."""
    path = "".join(f"M{a} {b}L{c} {d}" for a, b, c, d in ends.reshape(-1, 4).tolist())
    return f'<path stroke="{colour}" stroke-width="{BOLD / UNIT:.0f}" stroke-linecap="round" d="{path}"/>'


def _dots(points: Ints, colour: str, size: float, end: str) -> str:
    """A mark at each point: round, or square."""
    path = "".join(f"M{x} {y}h0" for x, y in points.tolist())
    return f'<path stroke="{colour}" stroke-width="{size:.0f}" stroke-linecap="{end}" d="{path}"/>' if path else ""
