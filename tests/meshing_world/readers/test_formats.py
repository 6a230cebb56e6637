"""One list of formats: the page, the help and the messages tell what is read."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import pytest
from checkout import ROOT

from envs.domains.load import load
from envs.readers.formats import BY_SUFFIX, FORMATS, Format
from envs.types import DomainError
from freemesh_ray.cli.command import parser


def test_the_page_has_a_row_for_each_format() -> None:
    lines = (ROOT / "docs" / "polygons.md").read_text(encoding="utf-8").splitlines()
    rows = [line for line in lines if line.startswith("| `.")]
    assert rows == [
        f"| {', '.join(f'`{suffix}`' for suffix in format.suffixes)} | {format.name} | {format.meaning} |"
        for format in FORMATS
    ]


def test_the_help_has_every_format(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parser().parse_args(["mesh", "--help"])
    told = " ".join(capsys.readouterr().out.split())
    for format in FORMATS:
        assert f"{' '.join(format.suffixes)} {format.name}: {format.meaning.replace('`', '')}" in told


@pytest.mark.parametrize("spec", ["part.stl", "nowhere"])
def test_messages_name_every_suffix(tmp_path: Path, spec: str) -> None:
    with pytest.raises(DomainError) as caught:
        load(str(tmp_path / spec) if "." in spec else spec)
    assert str(caught.value).endswith(", ".join(BY_SUFFIX))


@pytest.mark.parametrize("format", FORMATS, ids=lambda format: format.name)
def test_entries_are_complete(format: Format) -> None:
    reader = import_module(f"envs.readers.{format.module}")
    assert callable(getattr(reader, "drawing_of_file", None) or reader.polygons_of_file)
    assert all(suffix == suffix.lower() and suffix.startswith(".") for suffix in format.suffixes)
    assert "\n" not in format.meaning
    assert BY_SUFFIX.keys() == {suffix for each in FORMATS for suffix in each.suffixes}
    assert sum(len(each.suffixes) for each in FORMATS) == len(BY_SUFFIX), "no suffix twice"
