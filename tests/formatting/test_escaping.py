"""What others wrote stands for itself wherever it is shown, and there is one way to each place."""

from __future__ import annotations

import ast
import csv
import io
import json
import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from checkout import ROOT
from hostile_names import HOSTILE
from hypothesis import given
from hypothesis import strategies as st

from envs.domains.load import from_object
from envs.errors import UserError
from envs.printable import printable
from envs.types import DomainError
from freemesh_ray import export, plots
from freemesh_ray.compare import output as comparison
from freemesh_ray.compare.boundary_change import BoundaryChange
from freemesh_ray.compare.row import Row
from freemesh_ray.formatting import terminal
from freemesh_ray.formatting.csv_text import cell, csv_text
from freemesh_ray.formatting.html import embedded
from freemesh_ray.formatting.markdown import Markdown, block, bold, code, escaped
from freemesh_ray.formatting.table import markdown, table
from freemesh_ray.mesher.polygon_to_mesh import Mesh
from freemesh_ray.plots import replay

names = st.sampled_from(HOSTILE) | st.text(st.characters(codec=None, exclude_categories=()), max_size=40)


@given(names)
def test_printable_text_is_one_line_without_commands(name: str) -> None:
    shown = printable(name)
    assert shown.isprintable()
    shown.encode("utf-8")
    assert name != shown or name.isprintable()
    assert printable(shown) == shown


@given(names)
def test_messages_to_users_are_one_printable_line(name: str) -> None:
    assert str(UserError(f"{name}: is wrong")).isprintable()
    with pytest.raises(DomainError) as error:
        from_object([[0, 0], [1, 1]], name)
    assert str(error.value).isprintable()


@given(names, names)
def test_tables_keep_their_lines_and_columns(name: str, other: str) -> None:
    assert all(line.isprintable() for line in table(["a", name], [[other, name]]).split("\n"))
    assert len(table(["a", name], [[other, name]]).split("\n")) == 2
    lines = markdown([name, "b"], [[other, Markdown(f"{bold(name)} and {code(other)}")]]).split("\n")
    assert len(lines) == 3
    assert {len(re.findall(r"(?<!\\)(?:\\\\)*\|", line)) for line in lines} == {3}


@given(names)
def test_text_in_markdown_begins_nothing(name: str) -> None:
    text = escaped(name)
    assert text.isprintable()
    bare = re.sub(r"\\[\\`|*_(\[:]", "", text)
    assert not re.search(r"<|`|\||\\|\][(\[:]|\*\S|(?<!\w)_\S", bare)
    assert escaped(text) is text
    inner = re.fullmatch(r"(`+)(.*?)\1", code(name))
    assert inner
    assert inner[1] not in inner[2]
    first, *middle, last = block(name).split("\n")
    assert first == last
    assert all(first not in line and line.isprintable() for line in middle)


@pytest.mark.parametrize(
    "plain", ["D7", "part_1_2", "gmsh-default", "0.51 [0.40, 0.62]", "sing*", "a > b", "99 %", "R&D"]
)
def test_what_is_no_markup_stays_as_it_is(plain: str) -> None:
    assert escaped(plain) == plain
    assert cell(plain) == plain


@given(st.lists(st.tuples(names, names, st.floats(), st.integers()), min_size=1))
def test_no_cell_of_a_spreadsheet_is_a_formula(rows: list[tuple[str, str, float, int]]) -> None:
    text = csv_text(["=x", "b", "c", "d"], rows)
    text.encode("utf-8")
    read = list(csv.reader(io.StringIO(text, newline="")))
    assert len(read) == len(rows) + 1
    for found, given_row in zip(read[1:], rows, strict=True):
        for text_cell in found[:2]:
            assert not text_cell.lstrip().startswith(("=", "+", "-", "@")) or text_cell == "-"
            assert text_cell.isprintable()
        value = given_row[2]
        assert found[2] == ("" if not np.isfinite(value) else repr(value))
    assert read[0][0] == "'=x"


@given(names)
def test_data_in_a_page_cannot_end_its_script(name: str) -> None:
    text = embedded({"name": name})
    assert "<" not in text
    assert json.loads(text) == {"name": name}


SQUARE = [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]]


class Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.found.append(tag)


@pytest.mark.slow
@pytest.mark.parametrize("name", HOSTILE)
def test_files_of_a_mesh_hold_its_name_and_nothing_of_it_works(name: str, tmp_path: Path) -> None:
    mesh = Mesh.from_domain(from_object(SQUARE, name)[0])
    assert mesh.name.isprintable()
    raw = mesh.result.raw
    for suffix in (".vtu", ".svg"):
        mesh.write(tmp_path / f"mesh{suffix}")
        root = ET.parse(tmp_path / f"mesh{suffix}").getroot()
        assert not [node for node in root.iter() if "script" in str(node.tag)]
    for suffix in export.SUFFIXES:
        mesh.write(tmp_path / f"mesh{suffix}")
    for path in (tmp_path / "mesh.inp", tmp_path / "mesh.bdf", tmp_path / "mesh.obj", tmp_path / "mesh.msh"):
        assert all(line.isprintable() for line in path.read_text(encoding="ascii").split("\n")), path
    pages = []
    for each in (raw, Mesh.from_domain(from_object(SQUARE, "plain")[0]).result.raw):
        replay.write(each, tmp_path / "page.html")
        tags = Tags()
        tags.feed((tmp_path / "page.html").read_text())
        pages.append(tags.found)
    assert pages[0] == pages[1]


@pytest.mark.slow
def test_pictures_show_any_label(tmp_path: Path) -> None:
    mesh = Mesh.from_domain(from_object(SQUARE, "square")[0])
    labels = list(HOSTILE)
    drawn = {
        "side": lambda path: plots.draw_side_by_side(dict.fromkeys(labels, mesh), path, title=labels[18]),
        "boxes": lambda path: plots.draw_boxes(
            {"eta": {label: np.linspace(0, 1, 9) for label in labels}}, path, metrics=["eta"], title=labels[10]
        ),
        "curves": lambda path: plots.draw_curves(
            {label: ([0, 1], [i, 1]) for i, label in enumerate(labels[:8])}, path, title=labels[18], ylabel=labels[0]
        ),
        "settings": lambda path: plots.draw_settings(
            {"name": labels}, np.arange(len(labels)), path, labels[18], 0, labels[0]
        ),
    }
    for name, draw in drawn.items():
        draw(tmp_path / f"{name}.svg")
        text = (tmp_path / f"{name}.svg").read_text(encoding="utf-8")
        ET.fromstring(text)
        assert "\x1b" not in text
        assert "<script" not in text


def test_a_comparison_of_hostile_names_is_harmless(tmp_path: Path) -> None:
    figures = dict.fromkeys([*comparison.COLUMNS, "seconds"], 1.0)
    rows = [Row(name, other, figures if i % 2 else None, BoundaryChange(0, 0, 0, True), name)
            for i, (name, other) in enumerate(zip(HOSTILE, HOSTILE[::-1], strict=True))]  # fmt: skip
    absent = dict(zip(HOSTILE, HOSTILE[::-1], strict=True))
    comparison.write(tmp_path, rows, absent)
    text = (tmp_path / "comparison.md").read_text(encoding="utf-8")
    assert all(line.isprintable() for line in text.split("\n"))
    assert "<" not in text
    assert "](" not in text
    with open(tmp_path / "comparison.csv", newline="", encoding="utf-8") as file:
        for line in csv.reader(file):
            assert all(not value.startswith(("=", "+", "@")) for value in line)
    assert all(line.isprintable() for line in comparison.summary(rows, absent).split("\n"))


def test_lines_of_the_terminal_are_printable(capsys: pytest.CaptureFixture[str]) -> None:
    for name in HOSTILE:
        terminal.say(f"{name} begins")
        terminal.note(name)
    out, err = capsys.readouterr()
    assert all(line.isprintable() for line in [*out.split("\n"), *err.split("\n")])


#: What each way of showing is made of, and the one file where it may stand.
WAYS = {
    "isprintable": {"envs/printable.py", "freemesh_ray/export/finite_elements.py"},
    "csv.writer": {"freemesh_ray/formatting/csv_text.py"},
    "csv.DictWriter": set(),
    "html.escape": set(),
    "print": {"freemesh_ray/local_ray/start.py"},
}


def ways(source: str) -> set[str]:
    """Which of `WAYS` a source calls, and ``escape`` for one that writes an own one."""
    called = {ast.unparse(node.func) for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)}
    found = {way for way in WAYS if any(name == way or name.endswith(f".{way}") for name in called)}
    texts = {node.value for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Constant)}
    return found | ({"escape"} if texts & {"\\|", "&lt;", "\\u003c", "\x1b"} else set())


def test_the_files_that_are_permitted_exist_and_use_what_they_are_permitted() -> None:
    for way, places in WAYS.items():
        assert [place for place in places if way not in ways((ROOT / place).read_text())] == [], way


@pytest.mark.slow
def test_there_is_one_way_to_each_place() -> None:
    assert ways("import csv\ncsv.writer(f)\nprint(1)\nx.replace('|', '\\\\|')") == {"csv.writer", "print", "escape"}
    for path in [*(ROOT / "envs").rglob("*.py"), *(ROOT / "freemesh_ray").rglob("*.py")]:
        name = path.relative_to(ROOT).as_posix()
        for way in ways(path.read_text()):
            allowed = WAYS.get(way, {"freemesh_ray/formatting/markdown.py", "freemesh_ray/formatting/html.py"})
            assert name in allowed, f"{name} has its own {way}"
