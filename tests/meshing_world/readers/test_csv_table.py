"""Tables of vertices: every separator, header and way to tell rings apart gives the same domain."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.domains.load import load, load_all
from envs.readers.table import rings_of_table
from envs.types import DomainError

SQUARE = [(0.1, 0.25), (4.1, 0.25), (4.1, 4.25), (0.1, 4.25)]
HOLE = [(1.1, 1.25), (1.1, 2.25), (2.1, 2.25), (2.1, 1.25)]


def rows(ring: list[tuple[float, float]], separator: str, end: str = "") -> str:
    """A ring as rows."""
    return "".join(f"{x!r}{separator}{y!r}{end}\n" for x, y in ring)


GOOD = {
    "comma": ("part.csv", rows(SQUARE, ",") + "\n" + rows(HOLE, ",")),
    "spaced comma": ("part.csv", rows(SQUARE, " , ") + "\n\n\n" + rows(HOLE, ", ")),
    "semicolon": ("part.csv", rows(SQUARE, ";") + "\n" + rows(HOLE, ";")),
    "decimal comma": ("part.csv", rows(SQUARE, ";").replace(".", ",") + "\n" + rows(HOLE, ";").replace(".", ",")),
    "tab": ("part.tsv", rows(SQUARE, "\t") + "\n" + rows(HOLE, "\t")),
    "space": ("part.xy", rows(SQUARE, "  ") + "\n" + rows(HOLE, " ")),
    "text": ("part.txt", rows(SQUARE, " ") + "\n" + rows(HOLE, " ")),
    "header": ("part.csv", "x,y\n" + rows(SQUARE, ",") + "\n" + rows(HOLE, ",")),
    "quoted header": ("part.csv", '"X";"Y"\n' + rows(SQUARE, ";") + "\n" + rows(HOLE, ";")),
    "one word": ("part.dat", "PLATE 12\n".replace(" 12", "") + rows(SQUARE, " ") + "\n" + rows(HOLE, " ")),
    "ring column": ("part.csv", "x,y,ring\n" + rows(SQUARE, ",", ",0") + rows(HOLE, ",", ",1")),
    "ring column without header": ("part.csv", rows(SQUARE, ",", ",outer") + rows(HOLE, ",", ",inner")),
    "ring column first": ("part.csv", "ring,x,y\n" + "".join(f"7,{x},{y}\n" for x, y in SQUARE) + "\n"
                          + "".join(f"8,{x},{y}\n" for x, y in HOLE)),
    "comments": ("part.csv", "# outline\n" + rows(SQUARE, ",", " # corner") + "\n" + rows(HOLE, ",") + "\n# end"),
    "closed, Windows": ("part.csv", (rows([*SQUARE, SQUARE[0]], ",") + "\n" + rows(HOLE, ",")).replace("\n", "\r\n")),
    "hole first": ("part.csv", rows(HOLE, ",") + "\n" + rows(SQUARE, ",")),
}  # fmt: skip


@pytest.mark.parametrize(("name", "text"), GOOD.values(), ids=GOOD.keys())
def test_every_table_gives_the_same_domain(tmp_path: Path, name: str, text: str) -> None:
    path = tmp_path / name
    path.write_bytes(text.encode())
    domain = load(path)
    assert domain.name == "part"
    np.testing.assert_array_equal(domain.points[:8], [*SQUARE, *HOLE])


def test_rings_side_by_side_are_domains_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "part.csv"
    path.write_text("\n".join(rows([(x + 5.0 * i, y) for x, y in SQUARE], ",") for i in range(3)))
    domains = load_all(path)
    assert [domain.name for domain in domains] == ["part[0]", "part[1]", "part[2]"]
    assert [domain.points[0, 0] for domain in domains] == [0.1, 5.1, 10.1]


@given(st.lists(st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 2), min_size=1))
def test_numbers_survive_the_table(ring: list[tuple[float, float]]) -> None:
    for separator in (",", ";", "\t", " "):
        (read,) = rings_of_table(rows(ring, separator), "table")
        np.testing.assert_array_equal(read, ring)


BAD = {
    "word": ("0,0\n1,a\n", r"line 2: '1 a' where two numbers x and y are needed"),
    "one column": ("0\n1\n", "line 1: '0' where two numbers"),
    "header only": ("x,y\n", "no rows; give one 'x, y' row"),
    "comments only": ("# x,y\n", "no rows; give one 'x, y' row"),
    "few": ("0,0\n1,1\n", "outer ring: 2 vertices, at least 4"),
    "nan": ("0,0\n1,0\n1,1\n0,nan\n", "vertex 3 .*not finite"),
}


@pytest.mark.parametrize(("text", "message"), BAD.values(), ids=BAD.keys())
def test_bad_tables(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "part.csv"
    path.write_text(text)
    with pytest.raises(DomainError, match=message) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}: ")
