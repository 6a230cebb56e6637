"""The static site of all studies."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from urllib.parse import unquote

import pytest
import yaml

from envs.errors import BAD_INPUT, FAILED
from freemesh_ray.cli.command import main
from freemesh_ray.report.one_study import write as write_report
from freemesh_ray.report.site import write
from freemesh_ray.storage.atomic import OutputError
from freemesh_ray.studies.study_folder import StudyError
from tests.recorded_study import algorithms
from tests.report.test_html_page import HOSTILE, Page


@pytest.fixture
def studies(tmp_path: Path) -> Path:
    """Two studies; a title, and the name of a folder, that would be markup."""
    for name in ("first", "a <b> & %41#?"):
        folder = tmp_path / "studies" / name
        algorithms(folder, {"A": (60.0, 30e3), "B": (10.0, 30e3)}, domains=[], expects=["A > B"])
        path = folder / "study.yaml"
        tree = yaml.safe_load(path.read_text())
        tree["study"]["title"] = f"{name} {HOSTILE}"
        path.write_text(yaml.safe_dump(tree, sort_keys=False))
    (tmp_path / "studies" / "notes").mkdir()
    return tmp_path / "studies"


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.slow
def test_the_index_tells_of_every_study_and_leads_to_it(studies: Path, tmp_path: Path):
    made = write(studies, tmp_path / "site")
    index = Page(made.index.read_text())
    (table,) = index.tables
    assert [row[0] for row in table[1:]] == [f"{name} {HOSTILE}" for name in ("a <b> & %41#?", "first")]
    assert [row[1:5] for row in table[1:]] == [["2 variants: A, B", "1 confirmed", "3", "200k"]] * 2
    assert len(index.of("script")) == 1
    for path in (made.index, *made.pages.values()):
        for link in Page(path.read_text()).of("a"):
            if not link["href"].startswith("#"):
                assert (path.parent / unquote(link["href"])).is_file()
    addresses = [link["href"] for link in index.of("a") if not link["href"].startswith("#")]
    assert [unquote(address) for address in addresses] == ["studies/a <b> & %41#?.html", "studies/first.html"]
    assert "../index.html" in [link["href"] for link in Page(made.pages["first"].read_text()).of("a")]


@pytest.mark.slow
def test_again_it_is_the_same(studies: Path, tmp_path: Path):
    write(studies, tmp_path / "site")
    before = files(tmp_path / "site")
    write(studies, tmp_path / "site")
    assert files(tmp_path / "site") == before


@pytest.mark.slow
def test_pages_of_studies_that_are_gone_go_and_nothing_else_does(studies: Path, tmp_path: Path):
    site = tmp_path / "site"
    page = write(studies, site).pages["first"]
    others = [site / "CNAME", site / "own.html", page.with_name("own.html"), page.with_name("copy.html")]
    for path in others[:3]:
        path.write_text("<!doctype html>")
    shutil.copy(page, others[3])  # a copy under another name is its maker's
    shutil.rmtree(studies / "first")
    write(studies, site)
    assert not page.exists()
    assert all(path.exists() for path in others)
    assert sorted(files(site)) == sorted(
        ["index.html", "studies/a <b> & %41#?.html", *(str(path.relative_to(site)) for path in others)]
    )


@pytest.mark.parametrize("name", ["index.html", "studies/first.html"])
def test_a_page_that_is_somebody_s_is_kept(studies: Path, tmp_path: Path, name: str):
    path = tmp_path / "site" / name
    path.parent.mkdir(parents=True)
    path.write_text("mine")
    with pytest.raises(OutputError, match=r"is not a page of this site: move it"):
        write(studies, tmp_path / "site")
    assert files(tmp_path / "site") == {name: b"mine"}


@pytest.mark.slow
def test_a_study_that_cannot_be_read_is_listed_and_fails_the_command(
    studies: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    assert main(["report", "--site", "site", "--studies", str(studies)]) == 0
    assert capsys.readouterr().out.split() != []
    (studies / "first" / "trials.json").write_text("{")
    assert main(["report", "--site", "site", "--studies", str(studies)]) == FAILED
    assert "first" in capsys.readouterr().err
    page = Page((tmp_path / "site" / "index.html").read_text())
    (told,) = [line for line in page.said["li"] if line.strip()]
    assert told.startswith("first/trials.json: ")
    assert str(tmp_path) not in told
    assert not (tmp_path / "site" / "studies" / "first.html").exists()
    assert len(page.tables[0]) == 2


@pytest.mark.slow
def test_records_of_documents_are_studies_too(studies: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """As a clean clone has them; where the study itself is there, too, it counts."""
    monkeypatch.chdir(tmp_path)
    before = write(studies, tmp_path / "before").index.read_text()
    for name in ("first", "a <b> & %41#?"):
        write_report(studies / name, docs=tmp_path / "docs" / "studies")
    os.utime(tmp_path / "docs" / "studies" / "first" / "records.parquet", (0, 0))
    shutil.rmtree(studies / "a <b> & %41#?")
    (tmp_path / "docs" / "studies" / "broken").mkdir()
    (tmp_path / "docs" / "studies" / "broken" / "records.parquet").write_bytes(b"PAR1")
    assert main(["report", "--site", "site"]) == FAILED
    page = Page((tmp_path / "site" / "index.html").read_text())
    assert page.tables[0][1:] == Page(before).tables[0][1:]
    (told,) = [line for line in page.said["li"] if line.strip()]
    assert told.startswith("broken/records.parquet: holds no records of a study")
    assert "A > B" in (tmp_path / "site" / "studies" / "a <b> & %41#?.html").read_text().replace("&gt;", ">")
    assert sorted(path.name for path in studies.iterdir()) == ["first", "notes"]
    (tmp_path / "docs" / "studies" / "broken" / "records.parquet").unlink()
    shutil.rmtree(studies)
    assert main(["report", "--site", "site"]) == 0


@pytest.mark.slow
def test_a_folder_without_its_definition_is_told_as_such(studies: Path, tmp_path: Path):
    (studies / "first" / "study.yaml").unlink()
    assert write(studies, tmp_path / "site").unreadable == {"first": "first/study.yaml: no such file"}


def test_mistakes_are_one_line(studies: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    with pytest.raises(StudyError, match="no study in it"):
        write(tmp_path / "nowhere", tmp_path / "site")
    assert not (tmp_path / "site").exists()
    assert main(["report", "--site", str(tmp_path / "site"), "--docs", "docs"]) == BAD_INPUT
    assert capsys.readouterr().err.startswith("freemesh: --docs: goes with a NAME")
    for arguments in (["report"], ["report", "first", "--site", "site"]):
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == BAD_INPUT
