"""Pictures: what is on them, that they are written in both formats, and that the same mesh gives the same bytes."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import LineCollection, PathCollection, PolyCollection
from matplotlib.figure import Figure

from envs.mesh import Mesh
from envs.quality import element_quality
from freemesh_ray.atomic import OutputError
from freemesh_ray.colours import scale
from freemesh_ray.metrics import measure
from freemesh_ray.plots import caption, draw_boxes, draw_curves, draw_mesh, draw_side_by_side


def star(n: int) -> Mesh:
    """``n`` elements around one vertex, the valence of which is ``n``."""
    angles = np.pi * np.arange(2 * n) / n
    ring = np.column_stack([np.cos(angles), np.sin(angles)]) * np.where(np.arange(2 * n) % 2, 1.5, 1.0)[:, None]
    k = 2 * np.arange(n)
    quads = np.column_stack([np.full(n, 2 * n), k, k + 1, (k + 2) % (2 * n)])
    segments = np.column_stack([np.arange(2 * n), (np.arange(2 * n) + 1) % (2 * n)])
    return Mesh(f"star {n}", np.vstack([ring, [0.0, 0.0]]), quads, segments, True)


def part(mesh: Mesh, count: int) -> Mesh:
    return Mesh(mesh.name, mesh.vertices, mesh.quads[:count], mesh.segments, False)


def drawn(mesh: Mesh) -> dict[type, list]:
    """The artists of the mesh's axes by kind."""
    axes = Figure().add_subplot()
    draw_mesh(mesh, ax=axes)
    return {kind: [artist for artist in axes.collections if type(artist) is kind]
            for kind in (PolyCollection, LineCollection, PathCollection)}  # fmt: skip


@pytest.mark.parametrize("suffix", ["png", "svg"])
@pytest.mark.parametrize("mesh", [star(5), part(star(6), 2), part(star(4), 0)], ids=["whole", "part", "none"])
def test_the_same_mesh_gives_the_same_bytes(tmp_path: Path, suffix: str, mesh: Mesh):
    for name in ("a", "b"):
        draw_mesh(mesh, tmp_path / "new" / f"{name}.{suffix}")
    first = (tmp_path / "new" / f"a.{suffix}").read_bytes()
    assert first == (tmp_path / "new" / f"b.{suffix}").read_bytes()
    assert first.startswith(b"\x89PNG" if suffix == "png" else b"<?xml")
    assert len(first) > 4000


def test_elements_are_coloured_by_quality_on_a_fixed_scale():
    mesh = star(5)
    (elements,) = drawn(mesh)[PolyCollection]
    np.testing.assert_array_equal(elements.get_array(), element_quality(mesh.vertices, mesh.quads))
    assert elements.get_clim() == (0.0, 1.0)
    assert elements.get_linewidths()[0] < 1


def test_the_boundary_is_bolder_than_the_elements_and_is_the_given_segments():
    mesh = star(5)
    artists = drawn(mesh)
    (boundary,) = artists[LineCollection]
    np.testing.assert_array_equal(np.array(boundary.get_segments()), mesh.vertices[mesh.segments])
    assert boundary.get_linewidths()[0] > 2 * artists[PolyCollection][0].get_linewidths()[0]


@pytest.mark.parametrize(("n", "marks"), [(3, 1), (4, 0), (5, 1), (8, 1)])
def test_irregular_nodes_are_marked(n: int, marks: int):
    points = drawn(star(n))[PathCollection]
    assert len(points) == marks
    assert all(mark.get_offsets().tolist() == [[0.0, 0.0]] for mark in points)


def test_marks_tell_few_from_many_edges():
    few, many = (drawn(star(n))[PathCollection][0] for n in (3, 5))
    assert few.get_facecolor().tolist() != many.get_facecolor().tolist()
    assert few.get_label() == "valence 3"


def test_an_incomplete_mesh_is_shown_as_such():
    front, boundary = drawn(part(star(6), 2))[LineCollection]
    assert len(front.get_segments()) == 2
    assert len(boundary.get_segments()) == 12
    assert caption(part(star(6), 2)).startswith("INCOMPLETE · 2 elements · 0 irregular nodes\n$\\eta$ mean 0.")
    assert caption(part(star(6), 0)) == "INCOMPLETE · 0 elements · 0 irregular nodes"
    assert "INCOMPLETE" not in caption(star(6))


def test_figure_has_the_name_the_figures_and_a_colour_bar():
    figure = draw_mesh(star(5))
    mesh_axes, bar = figure.axes
    assert mesh_axes.get_title() == "star 5"
    assert mesh_axes.get_aspect() == 1.0
    assert not mesh_axes.axison
    assert mesh_axes.texts[0].get_text() == caption(star(5))
    assert caption(star(5)) == "5 elements · 1 irregular node\n$\\eta$ mean 0.771 · p5 0.771 · min 0.771"
    assert bar.get_ylim() == (0.0, 1.0)
    assert draw_mesh(star(5), title="Other").axes[0].get_title() == "Other"


def test_drawing_in_given_axes_leaves_the_figure_to_its_owner():
    figure = Figure()
    left, right = figure.subplots(1, 2)
    assert draw_mesh(star(3), ax=left) is figure
    assert len(figure.axes) == 2
    assert not right.collections


def test_no_pyplot_state_is_made():
    draw_mesh(star(5))
    pyplot = sys.modules.get("matplotlib.pyplot")
    assert pyplot is None or pyplot.get_fignums() == []


# ---- curves ----------------------------------------------------------------------------------------------------------


def test_a_band_spans_the_seeds_and_the_line_is_their_mean(tmp_path: Path):
    seeds = [([0, 10, 20], [0.0, 1.0, 2.0]), ([0, 5, 10, 20, 30], [2.0, 2.5, 3.0, 4.0, 9.0])]
    figure = draw_curves({"sac": seeds}, tmp_path / "curves.png", ylabel="return", title="Training")
    (axes,) = figure.axes
    (line,), (band,) = axes.lines, axes.collections
    np.testing.assert_allclose(line.get_xdata(), [0, 5, 10, 20])
    np.testing.assert_allclose(line.get_ydata(), [1.0, 1.5, 2.0, 3.0])
    heights = band.get_paths()[0].vertices
    assert heights[:, 1].min() == 0.0
    assert heights[:, 1].max() == 4.0
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_title()) == ("env steps", "return", "Training")
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["sac (mean of 2 seeds)"]


def test_a_single_curve_has_no_band_and_loses_what_is_no_number(tmp_path: Path):
    curve = (np.array([30, 0, 10, 20]), np.array([3.0, 0.0, np.nan, 2.0]))
    figure = draw_curves({"one": curve, "two": ([0, 1], [1, 1])}, tmp_path / "curves.svg")
    (axes,) = figure.axes
    assert len(axes.lines) == 2
    assert not axes.collections
    np.testing.assert_allclose(axes.lines[0].get_xydata(), [[0, 0], [20, 2], [30, 3]])


@pytest.mark.parametrize("series", [{}, {"none": []}, {"nan": ([0, 1], [np.nan, np.nan])}])
def test_nothing_to_draw_is_no_error(tmp_path: Path, series: dict):
    draw_curves(series, tmp_path / "curves.png")
    assert (tmp_path / "curves.png").stat().st_size > 1000


# ---- comparisons -----------------------------------------------------------------------------------------------------


def samples(count: int, seed: int) -> list[dict[str, float]]:
    rng = np.random.default_rng(seed)
    return [{name: value + rng.normal(0, 0.05) for name, value in measure(star(5)).items()} for _ in range(count)]


def test_boxes_show_quartiles_median_and_every_mesh(tmp_path: Path):
    groups = {"ours": samples(9, 0), "theirs": samples(6, 1), "none": []}
    figure = draw_boxes(groups, tmp_path / "boxes.png", metrics=["eta", "taper"], title="Two")
    assert [axes.get_title() for axes in figure.axes] == ["element quality $\\eta$", "taper"]
    assert [axes.texts[0].get_text() for axes in figure.axes] == ["→ higher is better", "← lower is better"]
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == ["ours", "theirs", "none"]
    for axes, metric in zip(figure.axes, ["eta", "taper"], strict=True):
        for row, box in enumerate(axes.patches):
            values = np.array([entry[metric] for entry in groups[list(groups)[row]]])
            x = box.get_path().vertices[:, 0]
            np.testing.assert_allclose([x.min(), x.max()], np.percentile(values, [25, 75]))
            np.testing.assert_array_equal(axes.collections[row].get_offsets()[:, 0], values)
            lines = [line.get_xdata() for line in axes.lines if np.allclose(line.get_ydata(), row, atol=0.3)]
            assert any(np.allclose(line, np.median(values)) for line in lines)
    assert figure.get_suptitle() == "Two"


def test_boxes_leave_out_what_is_no_number_and_name_unknown_metrics_as_they_are(tmp_path: Path):
    groups = {"ours": [{"cost": 1.0}, {"cost": float("nan")}, {}, {"cost": 3.0}]}
    figure = draw_boxes(groups, tmp_path / "boxes.svg", metrics=["cost", "gain"])
    assert [axes.get_title() for axes in figure.axes] == ["cost", "gain"]
    assert figure.axes[0].collections[0].get_offsets()[:, 0].tolist() == [1.0, 3.0]
    assert not figure.axes[1].collections


def test_the_default_panels_are_metrics_of_a_mesh(tmp_path: Path):
    figure = draw_boxes({"ours": samples(3, 0)}, tmp_path / "boxes.png")
    assert len(figure.axes) == 8
    assert all(len(axes.patches) == 1 for axes in figure.axes)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_meshes_side_by_side_share_one_scale_and_one_extent(tmp_path: Path, count: int):
    meshes = {f"mesher {i}": star(i + 3) for i in range(count)}
    figure = draw_side_by_side(meshes, tmp_path / "side.png", title="Stars")
    *panels, bar = figure.axes
    assert [axes.get_title() for axes in panels] == list(meshes)
    assert [axes.texts[0].get_text() for axes in panels] == [caption(mesh) for mesh in meshes.values()]
    assert {(axes.get_xlim(), axes.get_ylim()) for axes in panels} == {(panels[0].get_xlim(), panels[0].get_ylim())}
    assert {axes.collections[0].get_clim() for axes in panels} == {bar.get_ylim()} == {(0.0, 1.0)}
    shown = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert len(set(shown)) == len(shown) <= 2


def test_titles_and_figures_stay_on_the_page(tmp_path: Path):
    wide, tall = star(5), star(5)
    wide.vertices[:, 1] *= 0.05
    tall.vertices[:, 0] *= 0.05
    for mesh in (wide, tall):
        figures = [
            draw_side_by_side({"a": mesh, "b": mesh, "c": mesh}, tmp_path / "side.png", title="Stars"),
            draw_mesh(mesh, tmp_path / "mesh.png"),
        ]
        for figure in figures:
            page, texts = figure.bbox, [text for axes in figure.axes[:-1] for text in (axes.title, *axes.texts)]
            for extent in (text.get_window_extent() for text in texts):
                assert extent.y0 >= page.y0
                assert extent.y1 <= page.y1


@pytest.mark.parametrize("draw", [
    lambda path: draw_boxes({"ours": samples(3, 0)}, path),
    lambda path: draw_side_by_side({"a": star(5), "b": part(star(6), 2)}, path),
], ids=["boxes", "side by side"])  # fmt: skip
def test_comparisons_repeat_byte_by_byte_and_refuse_bad_places(tmp_path: Path, draw):
    for name in ("a.svg", "b.svg"):
        draw(tmp_path / "new" / name)
    assert (tmp_path / "new" / "a.svg").read_bytes() == (tmp_path / "new" / "b.svg").read_bytes()
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        draw(tmp_path / "file" / "a.png")


def test_nothing_to_compare_is_said(tmp_path: Path):
    with pytest.raises(ValueError, match="give at least one"):
        draw_side_by_side({}, tmp_path / "a.png")
    with pytest.raises(ValueError, match="name at least one"):
        draw_boxes({"ours": []}, tmp_path / "a.png", metrics=[])
    assert not list(tmp_path.iterdir())


def test_the_scale_as_colours_runs_from_the_worst_to_the_best():
    colours = scale(256)
    assert (colours[0], colours[-1]) == ("#440154", "#fde725")
    assert len(colours) == 256
    assert len(scale(20)) == 20
