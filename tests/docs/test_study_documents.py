"""The reports in the repository are what their records give, and the records' columns are as documented."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest
from checkout import ROOT, files

from freemesh_ray.records.schema import COLUMNS, FILE
from freemesh_ray.report.one_study import write_results
from freemesh_ray.report.results import from_records

RECORDS = [name for name in files() if re.fullmatch(rf"docs/studies/[^/]+/{re.escape(FILE)}", name)]


def cells(path: Path) -> list[list[str | float]]:
    """With numbers to nine digits: another processor may add them up in another order."""
    with open(path, encoding="utf-8", newline="") as file:
        return [[number(cell) for cell in row] for row in csv.reader(file)]


def number(cell: str) -> str | float:
    try:
        return float(f"{float(cell):.9g}")
    except ValueError:
        return cell


@pytest.mark.slow
@pytest.mark.parametrize("name", RECORDS)
def test_the_tables_of_a_study_are_what_its_records_give(name: str, tmp_path: Path) -> None:
    """Studies without records are not among them: their run folders are gone."""
    folder = (ROOT / name).parent
    write_results(from_records(ROOT / name), tmp_path)
    tables = sorted(path.name for path in tmp_path.glob("*.csv"))
    assert tables == sorted(path.name for path in folder.glob("*.csv"))
    for table in tables:
        assert cells(tmp_path / table) == cells(folder / table), table
    assert (tmp_path / FILE).read_bytes() == (ROOT / name).read_bytes()


def test_the_columns_of_records_are_documented() -> None:
    text = (ROOT / "docs" / "studies.md").read_text(encoding="utf-8")
    told = re.findall(r"^\| `(\w+)` \| (\S+) \| (.+) \|$", text.partition("## Records")[2], re.MULTILINE)
    figures = [row for row in told if row[0].startswith("eval_")]
    assert [row for row in told if row not in figures] == [(name, *column) for name, column in COLUMNS.items()]
