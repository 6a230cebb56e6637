"""The comparison's pictures: meshes of one domain side by side, and box plots of the eight metrics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from envs.quality import element_quality
from envs.types import Domain, Floats
from freemesh_ray.atomic import replacing
from freemesh_ray.compare.element_metrics import by_element, irregular, irregular_authors
from freemesh_ray.compare.mixed_mesh import MixedMesh
from freemesh_ray.plots import COLOURS, CURVES, DPI, INK, IRREGULAR, QUALITY

#: Metric -> title (L, H: lower or higher is better), highest value shown. The first and the last have one value a mesh,
#: the others one an element, by the authors' definitions, which the paper's figure shows.
BOXES: dict[str, tuple[str, float | None]] = {
    "singularity_authors": ("Singularity (L)", None),
    "eta": ("Element quality (H)", 1.0),
    "min_angle_authors": ("|MinAngle − 90°| (L)", 60.0),
    "max_angle_authors": ("|MaxAngle − 90°| (L)", 90.0),
    "scaled_jacobian": ("Scaled Jacobian (H)", 1.0),
    "stretch": ("Stretch (H)", 1.0),
    "taper": ("Taper (L)", 2.0),
    "triangles": ("#Triangles (L)", None),
}

#: Triangles have no quality: a colour that is none of the scale's.
TRIANGLE = "#d62728"

#: Panels in a row, and their size in inches.
ACROSS, PANEL = 3, 4.2

#: Box -> mesher -> values.
Boxes = Mapping[str, Mapping[str, Floats]]


def draw_meshes(meshes: Sequence[MixedMesh], domain: Domain, path: Path) -> None:
    """Draw the meshes of a domain side by side: quadrilaterals by quality, triangles red, irregular nodes marked.

    Args:
        meshes: at least one.
        domain: its given segments are drawn in bold.
        path: the picture to write.
    """
    columns = min(ACROSS, len(meshes))
    lines = -(-len(meshes) // columns)
    width, height = np.ptp(domain.points, axis=0)
    tall = PANEL * float(np.clip(height / max(width, 1e-300), 0.35, 1.6))
    figure = Figure(figsize=(columns * PANEL + 1.0, lines * (tall + 0.7)), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    panels = np.array(figure.subplots(lines, columns, squeeze=False)).ravel()
    for mesh, axes in zip(meshes, panels, strict=False):
        draw_panel(mesh, domain, axes)
    for axes in panels[len(meshes) :]:
        axes.set_axis_off()
    bar = figure.colorbar(ScalarMappable(QUALITY, COLOURS), ax=panels.tolist(), shrink=0.6, aspect=32, pad=0.01)
    bar.set_label("element quality $\\eta$", color=INK)
    bar.outline.set_visible(False)  # type: ignore[operator]
    figure.suptitle(domain.name, color=INK, fontweight="bold")
    save(figure, path)


def draw_panel(mesh: MixedMesh, domain: Domain, axes: Axes) -> None:
    """One mesh, its maker's name above and its figures below."""
    fine = float(np.clip(9.0 / np.sqrt(len(mesh) + 1.0), 0.15, 0.6))
    eta = element_quality(mesh.vertices, mesh.quads)
    quads = PolyCollection(list(mesh.vertices[mesh.quads]), cmap=COLOURS, norm=QUALITY, linewidths=fine)
    quads.set_array(eta)
    quads.set_edgecolor("white")
    axes.add_collection(quads)
    axes.add_collection(
        PolyCollection(list(mesh.vertices[mesh.triangles]), facecolors=TRIANGLE, edgecolors=INK, linewidths=fine)
    )
    axes.add_collection(
        LineCollection(list(domain.points[domain.segments]), colors=INK, linewidths=1.0, capstyle="round", zorder=4)
    )
    nodes = irregular(mesh)
    distinct, _ = mesh.edges
    valence = np.bincount(distinct.ravel(), minlength=len(mesh.vertices))[nodes]
    for (low, high), (marker, colour, _) in IRREGULAR.items():
        points = mesh.vertices[nodes[(valence >= low) & (valence <= high)]]
        axes.scatter(
            points[:, 0], points[:, 1], s=max(30 * fine, 4), marker=marker, color=colour, edgecolors="white",
            linewidths=fine / 3, zorder=5,
        )  # fmt: skip
    counts = f"{len(mesh.quads)} quads" + (f" + {len(mesh.triangles)} triangles" if len(mesh.triangles) else "")
    quality = f"$\\eta$ {eta.mean():.3f}" if len(eta) else "no quads"
    axes.set_title(mesh.mesher, color=INK, fontsize=10, fontweight="bold")
    axes.text(
        0.5, -0.02, f"{counts} · {quality} · {len(nodes)} irregular", transform=axes.transAxes, ha="center", va="top",
        color=INK, fontsize=8,
    )  # fmt: skip
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.autoscale_view()
    axes.margins(0.02)


def boxes(meshes: Sequence[Sequence[MixedMesh]]) -> dict[str, dict[str, Floats]]:
    """The values of each box: element metrics of all elements pooled, counts one a mesh.

    Args:
        meshes: those of each domain.
    """
    found: dict[str, dict[str, list[Floats]]] = {key: {} for key in BOXES}
    for mesh in (mesh for of_domain in meshes for mesh in of_domain):
        values = by_element(mesh)
        values["singularity_authors"] = np.array([float(len(irregular_authors(mesh)))])
        values["triangles"] = np.array([float(len(mesh.triangles))])
        for key in BOXES:
            found[key].setdefault(mesh.mesher, []).append(values[key])
    return {key: {name: np.concatenate(parts) for name, parts in groups.items()} for key, groups in found.items()}


def draw_boxes(groups: Boxes, path: Path) -> None:
    """Draw one panel a metric, one box a mesher: quartiles, median, whiskers to 1.5 times the box, outliers, mean.

    Values beyond a panel's scale, as of inverted elements, are counted in its title.
    """
    figure = Figure(figsize=(15.0, 7.6), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    for axes, (key, (title, highest)) in zip(figure.subplots(2, 4).ravel(), BOXES.items(), strict=True):
        names = list(groups[key])
        drawn = axes.boxplot(
            [values[np.isfinite(values)] for values in groups[key].values()], widths=0.6, patch_artist=True,
            showmeans=True, flierprops={"marker": ".", "markersize": 2, "markeredgecolor": "#888888", "alpha": 0.4},
            meanprops={"marker": "D", "markersize": 4, "markerfacecolor": "white", "markeredgecolor": INK},
            medianprops={"color": INK, "linewidth": 1.4},
        )  # fmt: skip
        for i, box in enumerate(drawn["boxes"]):
            box.set_facecolor(CURVES[i % len(CURVES)])
            box.set_alpha(0.65)
        axes.set_xticks(range(1, len(names) + 1), names, rotation=30, ha="right", fontsize=8)
        if highest is not None:
            axes.set_ylim(-0.02 * highest, 1.02 * highest)
            values = np.concatenate(list(groups[key].values()))
            if beyond := int((~((values >= 0.0) & (values <= highest))).sum()):
                title += f", {beyond} beyond"
        axes.set_title(title, color=INK, fontsize=11)
        axes.grid(axis="y", color="#dddddd", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    save(figure, path)


def save(figure: Figure, path: Path) -> None:
    """Write the picture; the same picture gives the same bytes."""
    with replacing(path) as draft:
        figure.savefig(draft, metadata={"Software": None}, facecolor="white")
