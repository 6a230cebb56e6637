"""The replay: what the page knows of the mesh, that no name breaks it, and that a browser plays it to the end."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from play import generic, turns
from test_plots import star

from envs.domains.load import load
from envs.mesh import Mesh
from envs.quality import element_quality
from freemesh_ray.plots import replay
from freemesh_ray.plots.colours import scale
from freemesh_ray.storage.atomic import OutputError

pytestmark = pytest.mark.slow

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


class Scripts(HTMLParser):
    """The texts of a page's scripts, as a browser finds them, and the names of all tags."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.tags: set[str] = set()
        self._open = False
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list) -> None:
        self.tags.add(tag)
        self._open = tag == "script"
        if self._open:
            self.found.append("")

    def handle_endtag(self, tag: str) -> None:
        self._open = False

    def handle_data(self, data: str) -> None:
        if self._open:
            self.found[-1] += data


def known(path: Path) -> dict[str, Any]:
    """The data of a page."""
    return json.loads(Scripts(path.read_text(encoding="utf-8")).found[0])


def holed() -> Mesh:
    """A grid of 7 by 6 elements without two of them."""
    x, y = np.meshgrid(np.arange(8.0), np.arange(7.0))
    vertices = np.column_stack([x.ravel(), y.ravel()]) + np.random.default_rng(1).uniform(-0.2, 0.2, (56, 2))
    i = (np.arange(6)[:, None] * 8 + np.arange(7)).ravel()
    quads = np.delete(np.column_stack([i, i + 1, i + 9, i + 8]), [16, 31], axis=0)
    edges, counts = Mesh("", vertices, quads, np.empty((0, 2), np.int64), False).edges
    return Mesh("grid", vertices, quads, edges[counts == 1], True)


def front_edges(mesh: Mesh, k: int) -> int:
    """Edges between what ``k`` elements cover and what is left, and the given segments that wait for an element."""
    edges, counts = replace(mesh, quads=mesh.quads[:k]).edges
    given = {tuple(edge) for edge in np.sort(mesh.segments, axis=1).tolist()}
    once = {tuple(edge) for edge in edges[counts == 1].tolist()}
    return len(given ^ once)


# ---- the page --------------------------------------------------------------------------------------------------------


@settings(max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(size=st.floats(1e-6, 1e6), x=st.floats(-1e6, 1e6))
def test_the_page_has_the_mesh_to_a_ten_millionth_of_its_extent(tmp_path: Path, size: float, x: float):
    mesh = holed()
    mesh = replace(mesh, vertices=mesh.vertices * size + [x, -x])
    replay.write(mesh, tmp_path / "a.html", finished=replace(mesh, quads=mesh.quads[::-1]))
    data = known(tmp_path / "a.html")
    extent = np.ptp(mesh.vertices, axis=0)
    for part, quads in ((data["raw"], mesh.quads), (data["finished"], mesh.quads[::-1])):
        vertices = np.reshape(part["vertices"], (-1, 2)) * data["step"] + data["origin"]
        np.testing.assert_allclose(vertices, mesh.vertices, rtol=0, atol=0.51e-7 * extent.max() + 1e-15 * abs(x))
        assert np.reshape(part["quads"], (-1, 4)).tolist() == quads.tolist()
        assert np.reshape(part["segments"], (-1, 2)).tolist() == mesh.segments.tolist()
        eta = np.array(part["eta"]) / data["etaUnit"]
        np.testing.assert_allclose(eta, element_quality(mesh.vertices, quads), rtol=0, atol=0.51e-4)
    assert data["scale"] == scale(len(data["scale"]))


@pytest.mark.parametrize(("n", "few", "many"), [(3, [6], []), (4, [], []), (5, [], [10]), (8, [], [16])])
def test_irregular_nodes_are_told_by_their_valence(tmp_path: Path, n: int, few: list[int], many: list[int]):
    replay.write(star(n), tmp_path / "a.html")
    raw = known(tmp_path / "a.html")["raw"]
    assert (raw["few"], raw["many"]) == (few, many)


@settings(max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(name=st.one_of(st.text(), st.sampled_from(["</script><b>", "<!--<script>", "{{data}}", "\u2028\\u003c", '"\\'])))
def test_no_name_breaks_out_of_the_data(tmp_path: Path, name: str):
    replay.write(holed(), tmp_path / "plain.html")
    name = name.encode("utf-8", "replace").decode("utf-8")
    replay.write(replace(holed(), name=name), tmp_path / "named.html")
    plain, named = (Scripts((tmp_path / f"{page}.html").read_text(encoding="utf-8")) for page in ("plain", "named"))
    assert known(tmp_path / "named.html")["name"] == name
    assert named.found[1:] == plain.found[1:]
    assert named.tags == plain.tags


def test_the_page_needs_nothing_but_itself(tmp_path: Path):
    replay.write(holed(), tmp_path / "a.html")
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "default-src 'none'" in page
    assert not re.search(r"https?:|src=|href=|@import|url\(|fetch\(|import\(", page)
    assert replay.PLACEHOLDER not in page


def test_the_same_mesh_gives_the_same_bytes(tmp_path: Path):
    for name in ("a", "b"):
        replay.write(holed(), tmp_path / "new" / f"{name}.html", finished=holed())
    assert (tmp_path / "new" / "a.html").read_bytes() == (tmp_path / "new" / "b.html").read_bytes()


def test_what_cannot_be_written_is_said_in_one_line_and_leaves_nothing(tmp_path: Path):
    mesh, empty = holed(), replace(holed(), name="empty", quads=np.empty((0, 4), np.int64), complete=False)
    (tmp_path / "file").write_text("")
    for path, raw, finished, message in (
        ("a.html", empty, None, "empty has no elements: there is nothing to replay"),
        ("a.html", mesh, empty, "empty has no elements: there is nothing to replay"),
        ("file/a.html", mesh, None, "cannot be written"),
    ):
        with pytest.raises(OutputError) as raised:
            replay.write(raw, tmp_path / path, finished=finished)
        assert str(raised.value).startswith(f"{tmp_path / path}: {message}")
        assert "\n" not in str(raised.value)
    assert [item.name for item in tmp_path.iterdir()] == ["file"]


# ---- in a browser ----------------------------------------------------------------------------------------------------

WATCH = "<script>addEventListener('error', (event) => { document.body.dataset.error = event.message; });</script>"
#: Runs steps one after the other and keeps what the page says of itself after each.
DRIVE = """<script>
(async () => {
  const seen = [];
  for (const step of [%s]) {
    await step();
    await new Promise((done) => setTimeout(done, 50));
    render();
    seen.push({ ...document.body.dataset });
  }
  document.body.dataset.seen = JSON.stringify(seen);
})();
</script>"""


def browse(page: Path, fragment: str = "", steps: list[str] | None = None, seconds: int = 5) -> list[dict[str, str]]:
    """Open a page, for seconds of its own clock; what it says of itself after each step, and at last."""
    if BROWSER is None:
        pytest.skip("no Chromium")
    html = page.read_text(encoding="utf-8").replace("<body>", f"<body>{WATCH}")
    if steps is not None:
        html = html.replace("</body>", DRIVE % ", ".join(f"() => {{ {step} }}" for step in steps) + "</body>")
    copy = page.with_name(f"driven-{page.name}")
    copy.write_text(html, encoding="utf-8")
    command = [
        BROWSER, "--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={page.parent / 'profile'}",
        "--window-size=1000,800", f"--virtual-time-budget={seconds * 1000}", "--dump-dom", f"{copy.as_uri()}{fragment}",
    ]  # fmt: skip
    ended = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    body = next(attributes for tag, attributes in Tags(ended.stdout).found if tag == "body")
    last = {name.removeprefix("data-"): value for name, value in body.items()}
    assert "error" not in last
    return [*json.loads(last.pop("seen", "[]")), last]


class Tags(HTMLParser):
    """The tags of a page with their attributes."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, Any]]] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list) -> None:
        self.found.append((tag, dict(attrs)))


def test_it_plays_to_the_end_and_shows_the_finished_mesh(tmp_path: Path):
    mesh = holed()
    finished = replace(mesh, quads=mesh.quads[::-1][:30], complete=False)
    replay.write(mesh, tmp_path / "raw.html")
    replay.write(mesh, tmp_path / "both.html", finished=finished)
    (last,) = browse(tmp_path / "raw.html", "#play&speed=60")
    assert (last["phase"], last["playing"], last["front"]) == ("raw", "false", "0")
    assert last["element"] == last["painted"] == last["elements"] == "40"
    assert float(last["mean"]) == pytest.approx(element_quality(mesh.vertices, mesh.quads).mean(), abs=1e-4)
    (last,) = browse(tmp_path / "both.html", "#play&speed=60")
    assert (last["phase"], last["playing"]) == ("finished", "false")
    assert last["painted"] == last["elements"] == "30"
    assert float(last["mean"]) == pytest.approx(element_quality(mesh.vertices, finished.quads).mean(), abs=1e-4)


def test_a_link_stands_still_at_its_element(tmp_path: Path):
    replay.write(holed(), tmp_path / "a.html")
    (last,) = browse(tmp_path / "a.html", "#element=10")
    assert (last["element"], last["painted"], last["playing"]) == ("10", "10", "false")
    assert int(last["front"]) == front_edges(holed(), 10)


def test_front_and_mean_are_those_of_the_elements_so_far(tmp_path: Path):
    *_, last = turns(generic(load("T1")), seed=1, limit=60)
    grown, holes = last.episodes.mesh(0), holed()
    for mesh in (grown, holes):
        replay.write(mesh, tmp_path / "a.html")
        counts = [len(mesh.quads), *np.random.default_rng(0).integers(0, len(mesh.quads) + 1, 8).tolist(), 1, 0]
        seen = browse(tmp_path / "a.html", steps=[f"location.hash = 'element={k}'" for k in counts])[:-1]
        eta = element_quality(mesh.vertices, mesh.quads)
        for k, entry in zip(counts, seen, strict=True):
            assert int(entry["painted"]) == k
            assert int(entry["front"]) == front_edges(mesh, k)
            assert entry["mean"] == "" if k == 0 else abs(float(entry["mean"]) - eta[:k].mean()) < 2e-4


def test_hands_on_the_page(tmp_path: Path):
    mesh = holed()
    replay.write(mesh, tmp_path / "a.html", finished=mesh)
    key = "dispatchEvent(new KeyboardEvent('keydown', {{ key: '{}', shiftKey: {} }}))".format
    centre = "const q = corners(11), x = q.reduce((s, v) => s + X(v) / 4, 0), y = q.reduce((s, v) => s + Y(v) / 4, 0);"
    move = f"{centre} layers.overlay.dispatchEvent(new PointerEvent('pointermove', {{ clientX: x, clientY: y }}))"
    wheel = "layers.overlay.dispatchEvent(new WheelEvent('wheel', { deltaY: -400, clientX: 300, clientY: 300 }))"
    steps = [
        ("location.hash = 'element=20'", {"element": "20", "playing": "false"}),
        (move, {"hovered": "12"}),
        (f"{wheel}; {move}", {"hovered": "12", "painted": "20"}),
        (key("ArrowRight", "false"), {"element": "21"}),
        (key("ArrowLeft", "true"), {"element": "11", "painted": "11"}),
        (f"hover(null); {move}", {"hovered": ""}),  # not cut yet
        (key("End", "false"), {"element": "40", "phase": "raw"}),
        (key("f", "false"), {"phase": "finished", "painted": "40"}),
        ("byId('raw-button').click()", {"phase": "raw", "playing": "false"}),
        (key("Home", "false"), {"element": "0", "front": str(len(mesh.segments))}),
        ("byId('scrubber').value = 7; byId('scrubber').dispatchEvent(new Event('input'))", {"element": "7"}),
        ("byId('forth').click()", {"element": "8"}),
        ("byId('play-button').click()", {"playing": "true"}),
        (key(" ", "false"), {"playing": "false"}),
    ]
    seen = browse(tmp_path / "a.html", steps=[step for step, _ in steps])
    for (step, expected), entry in zip(steps, seen[:-1], strict=True):
        assert {name: entry[name] for name in expected} == expected, step


def test_ten_thousand_elements_play(tmp_path: Path):
    i = (np.arange(100)[:, None] * 101 + np.arange(100)).ravel()
    vertices = np.stack(np.meshgrid(np.arange(101.0), np.arange(101.0)), axis=-1).reshape(-1, 2)
    mesh = Mesh("grid", vertices, np.column_stack([i, i + 1, i + 102, i + 101]), np.array([[0, 1]]), False)
    edges, counts = mesh.edges
    replay.write(replace(mesh, segments=edges[counts == 1], complete=True), tmp_path / "a.html")
    assert (tmp_path / "a.html").stat().st_size < 1_000_000
    (last,) = browse(tmp_path / "a.html", "#play&speed=5000")
    assert (last["painted"], last["front"], last["playing"]) == ("10000", "0", "false")
