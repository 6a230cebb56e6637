"""A picture of an episode: the elements cut so far, the front that is left, and the reference vertex."""

from __future__ import annotations

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from envs.mdp.episodes import Episodes

SIZE = 512  # pixels, width and height


def draw_episode(episodes: Episodes, i: int) -> np.ndarray:
    """(SIZE, SIZE, 3) uint8 drawing of episode ``i``."""
    mesh, ring, domain = episodes.mesh(i), episodes.ring(i), episodes.domain(i)
    figure = Figure(figsize=(SIZE / 100, SIZE / 100), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.02, 0.02, 0.96, 0.96))
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.add_collection(
        PolyCollection(list(mesh.vertices[mesh.quads]), facecolors="#dbe9f6", edgecolors="#5b7c99", linewidths=0.7)
    )
    axes.add_collection(PolyCollection(list(domain.points[domain.segments]), facecolors="none", edgecolors="#222222"))
    if len(ring):
        axes.add_collection(PolyCollection([ring], facecolors="none", edgecolors="#c0392b", linewidths=1.6))
        axes.plot(*ring.T, ".", color="#c0392b", markersize=3)
        axes.plot(*ring[0], "o", color="#e67e22", markersize=8)
    axes.autoscale_view()
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()
