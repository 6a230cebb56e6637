"""The catalogue's domains: data and drawings, rewritten by ``python -m envs.domains.catalogue.design``.

T1 to T3 are for training, from mild to hard: sharp angles, bottlenecks and uneven segments. D1 to D3 are one smooth
polygon at three densities, D4 to D6 go from simple to complex, D7 to D9 have sharp angles, narrow regions and uneven
segments, D9 a hole.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely

from envs.domains import outline_families
from envs.polygons import outline
from envs.polygons.validation import from_rings
from envs.types import Floats

FOLDER = Path(__file__).parent

#: Perimeter of D1 to D3.
PERIMETER = 15.1


@dataclass(frozen=True)
class Design:
    """One domain of the catalogue.

    Attributes:
        name: its name, and its files'.
        description: one line for tables.
        rings: the outer ring and then the holes, each (n, 2).
    """

    name: str
    description: str
    rings: Sequence[Floats]


def mirrored(half: Sequence[Sequence[float]]) -> list[Sequence[float]]:
    """Controls symmetric in x = 0, from those of the right half, top to bottom, its first and last on the axis."""
    left = [(-row[0], *row[1:]) for row in half[-2:0:-1]]
    return [*half, *left][::-1]


def fish() -> Design:
    """T1: three sharp tips and one bottleneck, all of them mild."""
    controls = [
        (-2.6, 0.05, 1), (-1.7, -0.62), (-0.5, -1.0), (0.7, -0.85), (1.6, -0.5), (2.15, -0.58), (2.95, -1.12, 1),
        (2.84, 0.0), (3.0, 1.1, 1), (2.15, 0.56), (1.6, 0.5), (0.8, 0.95), (-0.4, 1.15), (-1.7, 0.72),
    ]  # fmt: skip
    ring = outline.discretise(outline.spline(controls), 72, outline.near([(1.9, 0.0)], 3.2, 1.9))
    return Design("T1", "fish: three tips, a narrow tail root", [ring])


def bat() -> Design:
    """T2: more and sharper tips, two wings with narrow wrists, spacing that breaks the symmetry."""
    controls = mirrored([
        (0.0, 1.02), (0.22, 1.08), (0.42, 1.55, 1), (0.66, 0.78), (1.3, 0.68), (2.2, 1.48), (3.0, 2.0, 1), (3.55, 1.2),
        (3.9, 0.0, 1), (3.3, 0.28), (2.75, -0.35, 1), (2.2, 0.18), (1.55, -0.62, 1), (1.0, -0.15), (0.45, -1.1),
        (0.0, -1.75, 1),
    ])  # fmt: skip
    ring = outline.discretise(outline.spline(controls), 100, outline.wave(2.05, 0.5, 5.2))
    return Design("T2", "bat: sharp wings, narrow wrists", [ring])


def maple() -> Design:
    """T3: many sharp tips and deep valleys, lobes on narrow necks, a stem."""
    controls = mirrored([
        (0.0, 4.6, 1), (0.42, 3.55), (0.95, 3.75, 1), (0.75, 2.6), (0.4, 1.65, 1), (1.15, 2.05), (1.75, 2.75, 1),
        (2.0, 2.35), (3.6, 2.75, 1), (2.75, 1.75), (3.05, 1.25, 1), (2.0, 1.1), (1.2, 0.7, 1), (2.0, 0.2),
        (2.9, 0.25, 1), (2.6, -0.2), (3.1, -0.75, 1), (1.8, -0.75), (0.9, -0.72), (0.42, -0.75, 1), (0.36, -1.4),
        (0.5, -2.3, 1), (0.0, -2.3),
    ])  # fmt: skip
    ring = outline.discretise(outline.spline(controls), 144, outline.wave(2.2, 0.9, 6.5, 2.5))
    return Design("T3", "maple leaf: many sharp tips, narrow lobes and stem", [ring])


def duck(name: str, vertices: int) -> Design:
    """D1 to D3: smooth, with a concave neck and back, evenly spaced, its perimeter exactly that of the study."""
    controls = [
        (-3.0, 1.5), (-2.35, 1.8), (-2.1, 2.35), (-1.4, 2.75), (-0.72, 2.4), (-0.5, 1.75), (-0.42, 1.15), (0.3, 0.9),
        (1.4, 1.05), (2.4, 1.5), (3.1, 1.95), (3.08, 1.2), (2.75, 0.2), (2.05, -0.75), (0.9, -1.32), (-0.6, -1.38),
        (-1.8, -1.0), (-2.35, -0.2), (-2.1, 0.5), (-1.8, 0.95), (-2.1, 1.2), (-2.75, 1.2),
    ]  # fmt: skip
    ring = outline.discretise(outline.spline(controls)[::-1], vertices)
    ring = ring * (PERIMETER / np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1).sum())
    return Design(name, f"duck: smooth, {vertices} even segments", [ring])


def bracket() -> Design:
    """D4: an L of rounded corners with a foot."""
    polygon = shapely.union_all([
        shapely.box(-2.0, -1.5, -1.0, 1.8), shapely.box(-2.0, -1.5, 2.2, -0.6), shapely.box(1.4, -1.5, 2.2, 0.2)
    ])  # fmt: skip
    return Design("D4", "bracket: straight sides, rounded corners", [
        outline.discretise(outline_families.exterior(rounded(polygon, 0.22)), 84)
    ])  # fmt: skip


def gear() -> Design:
    """D5: eleven teeth with rounded flanks."""
    teeth = 11
    pitch = 2 * np.pi / teeth
    profile = [(-0.30, 1.45), (-0.17, 2.0), (0.17, 2.0), (0.30, 1.45)]
    polar = [(pitch * (k + turn), radius) for k in range(teeth) for turn, radius in profile]
    polygon = shapely.Polygon([(r * np.cos(a), r * np.sin(a)) for a, r in polar])
    return Design("D5", "gear: eleven rounded teeth", [
        outline.discretise(outline_families.exterior(rounded(polygon, 0.09)), 154)
    ])  # fmt: skip


def hand() -> Design:
    """D6: five fingers, four narrow clefts, a wrist."""
    fingers = [
        ((-0.62, 0.5), (-1.3, 2.3), 0.27), ((-0.2, 0.6), (-0.42, 2.95), 0.3), ((0.3, 0.6), (0.5, 2.95), 0.3),
        ((0.72, 0.3), (1.32, 2.35), 0.28), ((0.3, -0.7), (2.1, 0.75), 0.32),
    ]  # fmt: skip
    palm = shapely.Polygon([(-0.8, 0.7), (0.9, 0.7), (0.95, -0.7), (0.55, -1.5), (-0.6, -1.5), (-0.95, -0.5)])
    wrist = shapely.box(-0.5, -2.5, 0.5, -1.0)
    strokes = [shapely.LineString([a, b]).buffer(r, quad_segs=32) for a, b, r in fingers]
    return Design("D6", "hand: five fingers and the clefts between them", [
        outline.discretise(outline_families.exterior(rounded(shapely.union_all([palm, wrist, *strokes]), 0.1)), 190)
    ])  # fmt: skip


def rounded(polygon: shapely.Geometry, radius: float) -> shapely.Geometry:
    """A polygon opened and closed by a disc, so that its corners convex and reflex alike, become arcs."""
    smaller = polygon.buffer(-radius, quad_segs=32)
    return smaller.buffer(2 * radius, quad_segs=32).buffer(-radius, quad_segs=32)


def pine() -> Design:
    """D7: four tiers of drooping, sharp branches on narrow necks, and a trunk; fine near the top, coarse below."""
    controls = mirrored([
        (0.0, 5.4, 1), (0.38, 4.3), (1.25, 3.2, 1), (0.75, 3.28), (0.3, 3.5, 1), (0.8, 2.5), (1.9, 1.45, 1), (1.2, 1.6),
        (0.4, 1.95, 1), (1.0, 0.75), (2.5, -0.5, 1), (1.6, -0.3), (0.5, 0.1, 1), (1.2, -1.3), (3.1, -2.6, 1),
        (1.8, -2.35), (0.4, -2.1, 1), (0.36, -2.8), (0.7, -3.5, 1), (0.0, -3.4),
    ])  # fmt: skip
    ring = outline.discretise(outline.spline(controls), 190, outline.near([(0.0, 5.4), (0.0, 3.5)], 6.5, 2.6))
    return Design("D7", "pine: sharp branches on narrow necks, graded", [ring])


def snake() -> Design:
    """D8: one long narrow strip in growing bends, a pointed tail, a head behind a neck; segments follow its width."""
    # Langbein and Leopold's meander: the heading is a sine of the length, and so the bends are round.
    length = np.linspace(0.0, 15.0, 1601)
    swing = np.minimum.reduce([np.full_like(length, 1.75), 0.3 + 0.35 * length, 0.2 + 0.9 * (length[-1] - length)])
    heading = swing * np.sin(2 * np.pi * length / 4.1)
    along = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    line = np.cumsum(along, axis=0) * (length[1] - length[0])
    left = length[-1] - length
    body = 0.1 + 0.16 * np.sin(np.pi * np.clip(length / length[-1], 0.0, 1.0)) ** 0.8
    head = 0.3 * np.exp(-(((left - 0.75) / 0.42) ** 2))
    width = np.minimum.reduce([body + head, 0.25 * length, 0.52 * left])
    across = width[:, None] * np.stack([-along[:, 1], along[:, 0]], axis=1)
    polygon = shapely.Polygon(np.concatenate([line - across, (line + across)[::-1]]))
    spacing = outline.near([(0.0, 0.0), tuple(line[-1])], 3.5, 2.8)
    ring = outline.discretise(outline_families.exterior(polygon), 236, spacing)
    return Design("D8", "snake: a long narrow strip with pointed ends", [ring])


def saw() -> Design:
    """D9: raked teeth round a narrow rim, a bore with a keyway; fine at the tips, coarse at the bore."""
    teeth = 20
    turns = 2 * np.pi * np.arange(teeth) / teeth
    profile = [(0.0, 1.66, 0), (0.0, 2.05, 1), (0.16, 1.87, 0), (0.31, 1.68, 0), (0.36, 1.62, 0)]
    rake = 0.1
    controls = [
        (r * np.cos(a + turn - rake * (corner == 1)), r * np.sin(a + turn - rake * (corner == 1)), corner)
        for a in turns for turn, r, corner in [(p[0] * 2 * np.pi / teeth / 0.42, p[1], p[2]) for p in profile]
    ]  # fmt: skip
    rim = outline.spline(controls)
    tips = [row[:2] for row in controls if row[2]]
    bore = shapely.Point(0.0, 0.0).buffer(1.0, quad_segs=90).union(shapely.box(-0.18, 0.0, 0.18, 1.2))
    spacing = outline.near(tips, 0.9, 3.0)
    rings = [outline.discretise(rim, 240, spacing), outline.discretise(outline_families.exterior(bore), 44, spacing)]
    return Design("D9", "saw blade: raked teeth, a narrow rim, a bore with a keyway", rings)


DESIGNS: list[Callable[[], Design]] = [
    fish, bat, maple, lambda: duck("D1", 102), lambda: duck("D2", 150), lambda: duck("D3", 304),
    bracket, gear, hand, pine, snake, saw,
]  # fmt: skip


def main() -> None:
    """Write every design's data and drawing beside this file."""
    for make in DESIGNS:
        design = make()
        # What the catalogue cannot load shall not be written.
        from_rings(design.rings[0], design.rings[1:], design.name)
        (FOLDER / f"{design.name}.json").write_text(data(design), encoding="utf-8")
        draw(design, FOLDER / f"{design.name}.svg")


def data(design: Design) -> str:
    """The design as JSON, one vertex to a line, numbers in full."""
    rings = ",\n".join(
        "[\n" + ",\n".join(json.dumps(vertex) for vertex in ring.tolist()) + "\n]" for ring in design.rings
    )
    head = f'"name": {json.dumps(design.name)},\n"description": {json.dumps(design.description)}'
    return f'{{\n{head},\n"rings": [\n{rings}\n]\n}}\n'


def draw(design: Design, path: Path) -> None:
    """Draw the boundary with its vertices as an SVG that is the same on every run."""
    # Only drawing needs matplotlib: reading the catalogue does not.
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    with matplotlib.rc_context({"svg.hashsalt": "freemesh", "svg.fonttype": "none"}):
        figure, axes = plt.subplots(figsize=(5, 4))
        for ring in design.rings:
            axes.fill(*ring.T, facecolor="#e9f1f2" if ring is design.rings[0] else "white", edgecolor="#264653", lw=0.8)
            axes.plot(*ring.T, ".", color="#e76f51", markersize=3)
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_title(f"{design.name}, {design.description} ({sum(map(len, design.rings))} vertices)", fontsize=8)
        figure.savefig(path, format="svg", bbox_inches="tight", metadata={"Date": None, "Creator": None})
        plt.close(figure)


if __name__ == "__main__":
    main()
