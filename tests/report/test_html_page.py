"""The report as one page of HTML: the same words, in a file that needs nothing but itself."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from browser import CHROMIUM, Browser

from envs.domains.load import load
from freemesh_ray.formatting.markdown import escaped
from freemesh_ray.formatting.table import markdown
from freemesh_ray.policies.evaluation import run_episodes
from freemesh_ray.policies.policy import DEFAULT, Policy
from freemesh_ray.report import html_page, mesh_picture
from freemesh_ray.report.best_meshes import described
from freemesh_ray.report.one_study import write
from tests.recorded_study import algorithms

HOSTILE = "<script>alert(1)</script> & <b> \"x\" 'y' [a](javascript:b) ![c](d) *e* `f` | g"
SQUARE = [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]]
#: Attributes that load, or lead to, something.
ADDRESSES = ("src", "href", "srcset", "action", "data", "poster", "background")


class Page(HTMLParser):
    """What a page is made of."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.tables: list[list[list[str]]] = []
        self.open: list[str] = []
        self.said: dict[str, list[str]] = {}
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in ("meta", "img", "br", "link", "hr", "input"):
            self.open.append(tag)
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("th", "td"):
            self.tables[-1][-1].append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open:
            self.said.setdefault(self.open[-1], []).append(data)
        if any(tag in self.open for tag in ("th", "td")):
            self.tables[-1][-1][-1] += data

    def of(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a report with a title, and a domain, that would be markup."""
    folder = tmp_path_factory.mktemp("studies") / "algorithms"
    square = folder.parent / "a<i>b](c) [d.json"
    square.write_text(json.dumps(SQUARE))
    algorithms(folder, {"SAC": (62.0, 40e3), "PPO": (25.0, 90e3)}, domains=[str(square)], expects=["SAC > PPO"])
    path = folder / "study.yaml"
    tree = yaml.safe_load(path.read_text())
    tree["study"] |= {"title": HOSTILE, "finding": HOSTILE}
    path.write_text(yaml.safe_dump(tree, sort_keys=False))
    return write(folder, episodes=2).parent


@pytest.fixture(scope="module")
def page(report: Path) -> Page:
    return Page((report / "report.html").read_text())


def test_nothing_is_loaded(page: Page, report: Path):
    found = [attributes.get(name) for _, attributes in page.tags for name in ADDRESSES]
    for address in filter(None, found):
        assert address.startswith(("#", "data:image/"))
    images = page.of("img")
    assert len(images) == 3 + 2
    for image in images:
        kind, data = re.fullmatch(r"data:(image/\S+);base64,(.+)", image["src"] or "").groups()
        assert (
            base64.b64decode(data, validate=True).lstrip().startswith(b"<" if kind == "image/svg+xml" else b"\x89PNG")
        )
        assert image["alt"]
    policy = next(meta["content"] for meta in page.of("meta") if meta.get("http-equiv") == "Content-Security-Policy")
    assert "default-src 'none'" in policy
    assert not {"link", "iframe", "object", "form"} & {tag for tag, _ in page.tags}
    assert not re.search(r"@import|url\(", (report / "report.html").read_text())


def test_tables_have_the_cells_of_the_markdown(page: Page, report: Path):
    tables: list[list[list[str]]] = []
    before = ""
    for line in (report / "report.md").read_text().splitlines():
        if line.startswith("|") and not before.startswith("|"):
            tables.append([])
        if line.startswith("|") and not set(line) <= set("|-: "):
            cells = re.split(r"(?<!\\)\|", line)[1:-1]
            tables[-1].append([re.sub(r"\*\*|`|\\(?=\W)", "", cell).strip().replace("&lt;", "<") for cell in cells])
        before = line
    assert page.tables == tables
    assert len(tables) > 4


def test_text_of_others_stays_text(page: Page):
    assert "".join(page.said["h1"]) == HOSTILE
    assert "".join(page.said["title"]) == HOSTILE
    assert any(HOSTILE in said for said in page.said["p"])
    assert len(page.of("script")) == 1
    assert not page.of("b")
    assert not page.of("i")
    assert any("a<i>b](c) [d" in image["alt"] for image in page.of("img"))
    assert all(link["href"].startswith("#") for link in page.of("a"))


def test_any_text_is_text_in_a_heading_a_cell_a_line_and_a_description(tmp_path: Path):
    (tmp_path / "x.png").write_bytes(b"\x89PNG")
    text = "\n\n".join([f"# {escaped(HOSTILE)}", f"![{described(HOSTILE)}](x.png)", f"## {escaped(HOSTILE)}",
                        markdown([HOSTILE, "n"], [[HOSTILE, "1"]]), escaped(HOSTILE)])  # fmt: skip
    page = Page(html_page.page(text, tmp_path))
    assert page.tables == [[[HOSTILE, "n"], [HOSTILE, "1"]]]
    assert [image["alt"] for image in page.of("img")] == [HOSTILE]
    for tag in ("h1", "h2", "title", "p"):
        assert HOSTILE in page.said[tag] or HOSTILE in "".join(page.said[tag])
    assert any(HOSTILE in told for told in page.said["a"])
    assert len(page.of("script")) == 1


def test_html_in_markdown_stays_text(tmp_path: Path):
    page = Page(html_page.page("# a\n\n<script>b</script>\n\nc <b>d</b>\n", tmp_path))
    assert page.said["p"][:2] == ["<script>b</script>", "c <b>d</b>"]


def test_it_can_be_read_without_eyes(page: Page):
    levels = [int(tag[1]) for tag, _ in page.tags if re.fullmatch("h[1-6]", tag)]
    assert levels.count(1) == 1
    assert levels[0] == 1
    assert all(after <= before + 1 for before, after in zip(levels, levels[1:], strict=False))
    names = [attributes["id"] for tag, attributes in page.tags if tag in ("h2", "h3")]
    assert len(set(names)) == len(names)
    targets = [link["href"][1:] for link in page.of("a")]
    assert targets == ["content", *names]
    assert page.of("html")[0]["lang"] == "en"
    assert all(head["scope"] in ("col", "row") for head in page.of("th"))
    heads = [attributes["scope"] for tag, attributes in page.tags if tag == "th"]
    assert heads.count("row") == sum(len(table) - 1 for table in page.tables)


@pytest.mark.slow
def test_the_same_study_gives_the_same_bytes(report: Path):
    before = {path.name: path.read_bytes() for path in report.iterdir()}
    write(report.parent, episodes=2)
    assert {path.name: path.read_bytes() for path in report.iterdir()} == before


def test_a_mesh_has_all_its_elements_and_says_what_it_is():
    policy, domain = Policy.load(DEFAULT), load("T1")
    mesh = run_episodes(policy, domain, 1, stochastic=False, seed=0)[0].mesh
    text = mesh_picture.svg(mesh, f"{HOSTILE} \x1b")
    root = ElementTree.fromstring(text)
    assert root[0].text.startswith(HOSTILE)
    assert text.count("Z") == len(mesh.quads)
    assert mesh_picture.svg(mesh, "a") != mesh_picture.svg(mesh, "b")
    assert len(text) < 200 * len(mesh.quads) + 10_000


#: What a column shows -> the order of its rows, up and down.
COLUMNS = {
    ("9.0 ± 15.0", "77.0 ± 1.0", "-", "-2.2 ± 1.5"): ([3, 0, 1, 2], [1, 0, 3, 2]),
    ("1,200", "900", "+3.5 [1, 6]", "1e-05"): ([3, 2, 1, 0], [0, 1, 2, 3]),
    ("2.2 h", "11 min", "1.0 h", "90 min"): ([1, 2, 3, 0], [0, 3, 2, 1]),
    ("48k (3 of 3: 40 to 51k)", "never (0 of 3)", "9k", "110k"): ([2, 0, 3, 1], [3, 0, 2, 1]),
    ("99 ± 1 %", "100 %", "5 %", "5 %"): ([2, 3, 0, 1], [1, 0, 2, 3]),
    ("layers 10", "layers 9", "a", "3x wide"): ([3, 2, 1, 0], [0, 1, 2, 3]),
}


@pytest.mark.skipif(shutil.which("node") is None, reason="there is no Node")
def test_columns_sort_numbers_by_value(page: Page):
    script = "".join(page.said["script"])
    asked = json.dumps([list(column) for column in COLUMNS])
    script += f"\nconsole.log(JSON.stringify({asked}.map((c) => [sorted(c, false), sorted(c, true)])));"
    told = subprocess.run(["node", "-"], input=script, capture_output=True, text=True, timeout=60, check=True).stdout
    assert json.loads(told) == [list(map(list, orders)) for orders in COLUMNS.values()]


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium")
def test_a_click_sorts_and_tells_so(report: Path, tmp_path: Path):
    heads = "[...document.querySelectorAll('table')].find((t) => t.innerText.includes('IQM')).tHead.rows[0].cells"
    first = "[...document.querySelectorAll('table')].find((t) => t.innerText.includes('IQM')).tBodies[0].rows[0]"
    with Browser(tmp_path / "profile", 390, 800) as browser:
        browser.open((report / "report.html").as_uri())
        browser.wait_for("document.querySelectorAll('thead button').length")
        assert browser.evaluate("[...document.images].every((image) => image.naturalWidth > 0)")
        assert browser.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        for state, variant in (("ascending", "PPO"), ("descending", "SAC"), (None, "SAC")):
            browser.evaluate(f"{heads}[2].querySelector('button').click()")
            assert browser.evaluate(f"{heads}[2].getAttribute('aria-sort')") == state
            assert browser.evaluate(f"{first}.cells[0].innerText") == variant
