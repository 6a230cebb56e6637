"""Every link, picture and path of every document leads to a file that a clone has."""

from __future__ import annotations

import re

import pytest
from checkout import ROOT, files
from documents import anchors, blocks, documents, inline, leads_to, links

#: Files that commands write: no clone has them.
WRITTEN = {"config.yaml", "study.yaml", "trials.json"}
SOURCE = re.compile(r"[\w./-]+\.(?:py|md|yaml|json)")


@pytest.mark.parametrize("document", documents())
def test_links_lead_somewhere(document: str) -> None:
    lost = [target for target in links(document) if leads_to(document, target) is None]
    assert not lost


@pytest.mark.parametrize("document", documents())
def test_paths_in_the_text_exist(document: str) -> None:
    """From the root, beside the document, or a file's name alone where the text has named its folder."""
    beside = (ROOT / document).parent
    names = {name.rpartition("/")[2] for name in files()}
    lost = [
        str(code) + " " + code.text
        for code in inline(document)
        if SOURCE.fullmatch(code.text)
        and not ((ROOT / code.text).is_file() or (beside / code.text).is_file())
        and not ("/" not in code.text and code.text in names | WRITTEN)
    ]
    assert not lost


@pytest.mark.parametrize("document", documents())
def test_a_block_says_what_it_holds(document: str) -> None:
    """So that no command hides in one."""
    for block in blocks(document):
        assert block.language in ("sh", "python", "yaml", "text"), f"{block}: say ```sh, ```python, ```yaml or ```text"


def test_documents_have_links() -> None:
    assert sum(len(links(document)) for document in documents()) > 50
    assert any("#" in target for document in documents() for target in links(document))


@pytest.mark.parametrize("target", ["nowhere.md", "#nowhere", "docs/studies.md#nowhere", "LICENSE#mit", "../README.md"])
def test_a_lost_link_is_noticed(target: str) -> None:
    assert leads_to("README.md", target) is None


def test_anchors_are_those_of_github() -> None:
    assert {"in-mlflow", "metrics", "what-it-leaves"} <= anchors("docs/studies.md")
    assert "the-mesher-polygons-that-it-was-not-trained-on" in anchors("docs/results.md")
