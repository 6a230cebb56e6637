"""The catalogue's shapes: data and drawings, rewritten by ``python -m envs.domains.design``.

T1 to T3 are for training, from mild to hard: sharp angles, bottlenecks and uneven segments. D1 to D3 are one smooth
shape at three densities, D4 to D6 go from simple to complex, D7 to D9 have sharp angles, narrow regions and uneven
segments, D9 a hole.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from envs import outline
from envs.polygon import from_rings
from envs.types import Domain, Floats

FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class Design:
    """One shape of the catalogue.

    Attributes:
        name: its name, and its files'.
        description: one line for tables.
        rings: the outer ring and then the holes, each (n, 2).
    """

    name: str
    description: str
    rings: Sequence[Floats]


def fish() -> Design:
    """T1: nose and tail tips, a narrow tail root."""
    body = [
        (-2.6, 0.05, 1), (-1.7, -0.62), (-0.5, -1.0), (0.7, -0.85), (1.6, -0.5), (2.15, -0.58), (2.95, -1.12, 1),
        (2.84, 0.0), (3.0, 1.1, 1), (2.15, 0.56), (1.6, 0.5), (0.8, 0.95), (-0.4, 1.15), (-1.7, 0.72),
    ]  # fmt: skip
    return Design("T1", "fish: three sharp tips and a narrow tail root", [
        outline.discretise(outline.spline(body), 40, outline.near([(1.9, 0.0)], 3.2, 1.9))
    ])  # fmt: skip


def bat() -> Design:
    """T2."""
    half = [
        (0.0, 1.02), (0.22, 1.08), (0.42, 1.55, 1), (0.66, 0.78), (1.3, 0.68), (2.2, 1.48), (3.0, 2.0, 1),
        (3.55, 1.2), (3.9, 0.0, 1), (3.3, 0.28), (2.75, -0.35, 1), (2.2, 0.18), (1.55, -0.62, 1), (1.0, -0.15), (0.45, -1.1),
    ]  # fmt: skip
    left = [(-row[0], *row[1:]) for row in half[:0:-1]]
    body = [*half, (0.0, -1.75, 1), *left][::-1]
    return Design("T2", "bat", [outline.discretise(outline.spline(body), 60, outline.wave(2.05, 0.5, 5.2))])


def leaf() -> Design:
    """T3."""
    half = [
        (0.0, 4.6, 1), (0.42, 3.55), (0.95, 3.75, 1), (0.75, 2.6), (0.4, 1.65, 1),
        (1.15, 2.05), (1.75, 2.75, 1), (2.0, 2.35), (3.6, 2.75, 1), (2.75, 1.75), (3.05, 1.25, 1), (2.0, 1.1), (1.2, 0.7, 1),
        (2.0, 0.2), (2.9, 0.25, 1), (2.6, -0.2),(3.1, -0.75, 1), (1.8, -0.75), (0.9, -0.72), (0.42, -0.75, 1),
        (0.36, -1.4), (0.5, -2.3, 1),
    ]  # fmt: skip
    left = [(-row[0], *row[1:]) for row in half[:0:-1]]
    body = [*half, *left][::-1]
    return Design("T3", "maple leaf", [outline.discretise(outline.spline(body), 96, outline.wave(2.3, 0.9, 6.5, 2.5))])


DESIGNS: list[Callable[[], Design]] = [fish, bat, leaf]


def main() -> None:
    """Write every design's data and drawing beside this file."""
    for make in DESIGNS:
        design = make()
        domain = from_rings(design.rings[0], design.rings[1:], design.name)
        (FOLDER / f"{design.name}.json").write_text(data(design), encoding="utf-8")
        draw(domain, design.description, FOLDER / f"{design.name}.svg")


def data(design: Design) -> str:
    """The design as JSON, one vertex to a line, numbers in full."""
    rings = ",\n".join(
        "[\n" + ",\n".join(json.dumps(vertex) for vertex in ring.tolist()) + "\n]" for ring in design.rings
    )
    head = f'"name": {json.dumps(design.name)},\n"description": {json.dumps(design.description)}'
    return f'{{\n{head},\n"rings": [\n{rings}\n]\n}}\n'


def draw(domain: Domain, description: str, path: Path) -> None:
    """Draw the boundary with its vertices as an SVG that is the same on every run."""
    # Only drawing needs matplotlib: reading the catalogue does not.
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib.collections import LineCollection

    with matplotlib.rc_context({"svg.hashsalt": "freemesh", "svg.fonttype": "none"}):
        figure, axes = plt.subplots(figsize=(5, 4))
        axes.add_collection(LineCollection(list(domain.points[domain.segments]), colors="#264653", linewidths=0.8))
        given = domain.points[np.unique(domain.segments)]
        axes.plot(*given.T, ".", color="#e76f51", markersize=3)
        axes.set_aspect("equal")
        axes.autoscale_view()
        axes.set_axis_off()
        axes.set_title(f"{domain.name}: {description} ({len(given)} vertices)", fontsize=8)
        figure.savefig(path, format="svg", bbox_inches="tight", metadata={"Date": None, "Creator": None})
        plt.close(figure)


if __name__ == "__main__":
    main()
