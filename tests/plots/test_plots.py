"""Pictures: what is on them, that they are written in both formats, and that the same mesh gives the same bytes."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import LineCollection, PathCollection, PolyCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from envs.mesh import Mesh
from envs.quality import element_quality
from freemesh_ray.compare.mixed_mesh import assembled
from freemesh_ray.plots import PANELS, caption, draw_boxes, draw_curves, draw_mesh, draw_side_by_side
from freemesh_ray.plots.colours import TRIANGLE, scale
from freemesh_ray.storage.atomic import OutputError


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


@pytest.mark.slow
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
    assert caption(part(star(6), 2)).startswith("INCOMPLETE · 2 elements · 0 irregular nodes\nη mean 0.")
    assert caption(part(star(6), 0)) == "INCOMPLETE · 0 elements · 0 irregular nodes"
    assert "INCOMPLETE" not in caption(star(6))


def test_figure_has_the_name_the_figures_and_a_colour_bar():
    figure = draw_mesh(star(5))
    mesh_axes, bar = figure.axes
    assert mesh_axes.get_title() == "star 5"
    assert mesh_axes.get_aspect() == 1.0
    assert not mesh_axes.axison
    assert mesh_axes.texts[0].get_text() == caption(star(5))
    assert caption(star(5)) == "5 elements · 1 irregular node\nη mean 0.771 · p5 0.771 · min 0.771"
    assert bar.get_ylim() == (0.0, 1.0)
    assert draw_mesh(star(5), title="Other").axes[0].get_title() == "Other"


def test_the_caption_tells_the_mean_from_the_poorest():
    mesh = star(5)
    moved = Mesh("moved", np.vstack([mesh.vertices[:-1], [0.3, 0.1]]), mesh.quads, mesh.segments, True)
    eta = element_quality(moved.vertices, moved.quads)
    mean, p5, least = (f"{value:.3f}" for value in (eta.mean(), np.percentile(eta, 5), eta.min()))
    assert len({mean, p5, least}) == 3
    assert caption(moved).splitlines()[1] == f"η mean {mean} · p5 {p5} · min {least}"


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


def samples(count: int, seed: int) -> dict[str, dict[str, np.ndarray]]:
    """Values of three meshers for every metric, the third without any."""
    rng = np.random.default_rng(seed)
    return {
        metric: {"ours": rng.uniform(0, 1, count), "theirs": rng.uniform(0, 0.5, 2 * count), "none": np.empty(0)}
        for metric in PANELS
    }


@pytest.mark.parametrize("count", [6, 60], ids=["few", "many"])
def test_boxes_show_quartiles_median_and_values(tmp_path: Path, count: int):
    values = samples(count, 0)
    figure = draw_boxes(values, tmp_path / "boxes.png", metrics=["eta", "triangles"], title="Two")
    assert [axes.get_title() for axes in figure.axes] == ["element quality η", "triangles"]
    notes = [axes.texts[0].get_text() for axes in figure.axes]
    assert notes == ["each element · ↑ higher is better", "each mesh · ↓ lower is better"]
    assert figure.get_suptitle() == "Two"
    for axes, metric in zip(figure.axes, ["eta", "triangles"], strict=True):
        assert [label.get_text() for label in axes.get_xticklabels()] == ["ours", "theirs", "none"]
        assert len(axes.patches) == 2
        for place, (box, drawn) in enumerate(zip(axes.patches, values[metric].values(), strict=False)):
            heights = box.get_path().vertices[:, 1]
            np.testing.assert_allclose([heights.min(), heights.max()], np.percentile(drawn, [25, 75]))
            lines = [line.get_ydata() for line in axes.lines if np.allclose(line.get_xdata(), place, atol=0.4)]
            assert any(len(line) == 2 and np.allclose(line, np.median(drawn)) for line in lines)
            low, high = axes.get_ylim()
            assert low <= drawn.min() <= drawn.max() <= high
        if count <= 10:
            np.testing.assert_array_equal(axes.collections[0].get_offsets()[:, 1], values[metric]["ours"])


def test_values_off_the_scale_are_counted_and_infinite_ones_left_out(tmp_path: Path):
    values = {"taper": {"ours": np.array([0.1, 0.2, 0.3, 7.0, np.inf, np.nan]), "theirs": np.array([0.5, -1.0])}}
    (axes,) = draw_boxes(values, tmp_path / "boxes.svg", metrics=["taper"]).axes
    assert axes.texts[0].get_text() == "each element · ↓ lower is better · 2 off scale"
    assert axes.get_ylim() == pytest.approx((0.1 - 0.016, 0.5 + 0.016))


def test_the_default_panels_are_the_papers_eight(tmp_path: Path):
    figure = draw_boxes(samples(3, 0), tmp_path / "boxes.png")
    assert len(figure.axes) == len(PANELS) == 8
    assert all(len(axes.patches) == 2 for axes in figure.axes)
    labels = [[label.get_text() for label in axes.get_xticklabels()] for axes in figure.axes]
    assert labels == [[]] * 4 + [["ours", "theirs", "none"]] * 4


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


def test_triangles_are_red_and_a_failure_is_an_empty_panel(tmp_path: Path):
    whole = star(5)
    (a, b, c, d), quads = whole.quads[0], whole.quads[1:]
    mixed = assembled("mixed", whole.vertices, quads, [[a, b, c], [a, c, d]], 1.0)
    figure = draw_side_by_side({"mixed": mixed, "failed": None}, tmp_path / "side.png")
    panel, empty, _ = figure.axes
    assert panel.texts[0].get_text() == caption(mixed)
    assert caption(mixed).startswith("4 quads · 2 triangles · 1 irregular node\n")
    triangles = next(artist for artist in panel.collections if artist.get_label() == "triangle")
    assert len(triangles.get_paths()) == 2
    assert to_hex(triangles.get_facecolor()[0]) == TRIANGLE
    assert "triangle" in [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert (empty.get_title(), empty.texts[0].get_text()) == ("failed", "no mesh")
    assert not empty.collections


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.parametrize("draw", [
    lambda path: draw_boxes(samples(3, 0), path),
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
    with pytest.raises(ValueError, match="give at least one"):
        draw_side_by_side({"failed": None}, tmp_path / "a.png")
    with pytest.raises(ValueError, match="name at least one"):
        draw_boxes({}, tmp_path / "a.png", metrics=[])
    assert not list(tmp_path.iterdir())


def test_the_scale_as_colours_runs_from_the_worst_to_the_best():
    colours = scale(256)
    assert (colours[0], colours[-1]) == ("#440154", "#fde725")
    assert len(colours) == 256
    assert len(scale(20)) == 20
