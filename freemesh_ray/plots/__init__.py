"""Pictures of meshes, learning curves and comparisons, PNG or SVG by the file's extension.

Everything is drawn on `Figure` objects of its own, without pyplot: no window, no state shared between callers.
"""

from envs.rendering import quiet_matplotlib as quiet_matplotlib
from freemesh_ray.plots.bands import Panel, draw_bands
from freemesh_ray.plots.boxes import PANELS, draw_boxes
from freemesh_ray.plots.improvement_plot import Pair, draw_improvements
from freemesh_ray.plots.learning_curves import draw_curves
from freemesh_ray.plots.mesh_plot import caption, draw_mesh, mesh_png
from freemesh_ray.plots.names_plot import draw_names
from freemesh_ray.plots.page import SUFFIXES
from freemesh_ray.plots.settings import draw_settings
from freemesh_ray.plots.side_by_side import draw_side_by_side

__all__ = [
    "PANELS", "SUFFIXES", "Pair", "Panel", "caption", "draw_bands", "draw_boxes", "draw_curves", "draw_improvements",
    "draw_mesh", "draw_names", "draw_settings", "draw_side_by_side", "mesh_png",
]  # fmt: skip
