"""docs/formats.md says of each format what `formats.FORMATS` says."""

from __future__ import annotations

from checkout import ROOT

from freemesh_ray.export import FORMATS
from freemesh_ray.export.formats import COLUMNS, kept
from freemesh_ray.formatting.table import markdown


def test_the_table_is_that_of_the_formats():
    text = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8")
    section = text.partition("## What each format keeps\n\n")[2].partition("\n\n")[0]
    assert section == markdown(COLUMNS, [kept(suffix) for suffix in FORMATS]).strip()


def test_every_format_has_a_paragraph():
    text = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8").partition("## The formats")[2]
    for suffix in FORMATS:
        assert f"`{suffix}`" in text, suffix
