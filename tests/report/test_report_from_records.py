"""Reports made anew from records alone: the same tables, numbers and pictures as from the run folders."""

from __future__ import annotations

import json
import os
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from confined import confined_pool, each
from mutants import mutants
from recorded_study import algorithms

from envs.errors import BAD_INPUT, UserError
from freemesh_ray.cli import command
from freemesh_ray.records import parquet_file
from freemesh_ray.records.schema import FILE
from freemesh_ray.records.study_records import RecordsError
from freemesh_ray.report.one_study import write, write_results
from freemesh_ray.report.results import from_records
from tests.report.test_report import SQUARE, change, search

#: The line that says where a report was made.
MADE = re.compile(r"^- this report was made on .*\n|^- \d+ trials? from records, .*\n", re.MULTILINE)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With all that a study may have: domains, one of them gone; failed, waiting and lost trainings; secrets."""
    home = tmp_path_factory.mktemp("studies")
    (home / "square.json").write_text(json.dumps(SQUARE))
    domains = [str(home / "square.json"), "nowhere.json", "T1"]
    folder = algorithms(home / "own", {"A": (60.0, 30e3), "B": (10.0, 30e3), "C": (0.0, 1e4)}, [1, 2, 3],
                        domains=domains, expects=["A > B", "B = C"])  # fmt: skip
    change(folder, 1, status="failed", error="ValueError: |no\nluck")
    (folder / "runs" / "B-1" / "policy.npz").unlink()
    shutil.rmtree(folder / "runs" / "C-3")
    change(folder, 8, status="pending")
    for run in (folder / "runs").iterdir():
        text = (run / "config.yaml").read_text()
        (run / "config.yaml").write_text(text.replace("uri: null", "uri: postgresql://me:secret@host/db"))
        assert "secret" in (run / "config.yaml").read_text()
    tree = yaml.safe_load((folder / "study.yaml").read_text())
    tree["settings"]["tracking.uri"] = "http://me:secret@host"
    (folder / "study.yaml").write_text(yaml.safe_dump(tree))
    (folder / "source.json").write_text('{"envs": "0123", "ray": "2.60.0"}')
    (folder / "runs" / "A-1" / "finished.json").write_text('{"env_steps": 200001, "updates": 17}')
    write(folder, episodes=2)
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix not in (".md", ".html")}


@pytest.mark.slow
def test_all_that_a_report_has_is_made_anew(study: Path, tmp_path: Path) -> None:
    alone = tmp_path / "elsewhere" / FILE
    alone.parent.mkdir()
    shutil.copy(study / "report" / FILE, alone)
    hidden = study.rename(study.with_name("hidden"))
    try:
        again = write_results(from_records(alone), tmp_path / "again")
    finally:
        hidden.rename(study)
    tables = {f"{name}.csv" for name in ("curves", "final", "domains", "profile", "comparisons", "expectations")}
    drawn = {"curves.png", "profile.svg", "mesh-1-1.svg", "mesh-2-3.svg"}
    assert {FILE} | tables | drawn <= contents(study / "report").keys()
    assert contents(again.parent) == contents(study / "report")
    before, now = (MADE.sub("", path.read_text()) for path in (study / "report" / "report.md", again))
    assert now == before
    assert "trials from records, without their policies" in again.read_text()
    write_results(from_records(again.parent / FILE), tmp_path / "third")
    assert contents(tmp_path / "third") == contents(again.parent)
    assert (tmp_path / "third" / "report.html").read_bytes() == (again.parent / "report.html").read_bytes()


@pytest.mark.slow
def test_a_report_written_twice_has_the_same_records(study: Path, tmp_path: Path) -> None:
    write(study, out=tmp_path, episodes=2)
    assert (tmp_path / FILE).read_bytes() == (study / "report" / FILE).read_bytes()


def test_records_have_what_was_trained_and_no_secrets(study: Path) -> None:
    records = parquet_file.read(study / "report" / FILE)
    assert records.source == {"envs": "0123", "ray": "2.60.0"}
    assert (records.name, records.episodes) == ("own", 2)
    assert len(records.trainings) == 9
    first = records.trainings[0]
    assert (first.label, first.seed, first.run, first.updates, first.status) == ("A", 1, "A-1", 17, "finished")
    assert first.measured is not None
    assert first.measured.commit.startswith("0123456789")
    assert first.settings["budget.env_steps"] == 200_000
    assert not [key for each in records.trainings for key in each.settings if key.startswith(("paths", "tracking"))]
    assert "secret" not in repr(records)
    assert "curriculum" in records.study
    with_meshes = [each for each in records.trainings if each.measured and each.measured.meshes]
    assert sorted(each.label for each in with_meshes) == ["A", "B", "C"]


@pytest.mark.slow
def test_a_search_is_made_anew(tmp_path: Path) -> None:
    before = write(search(tmp_path / "rates"))
    again = write_results(from_records(before.parent / FILE), tmp_path / "again")
    assert contents(again.parent) == contents(before.parent)
    assert MADE.sub("", again.read_text()) == MADE.sub("", before.read_text())


# ---- the command -----------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_command_writes_it_where_no_study_lies(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    file = str(study / "report" / FILE)
    assert command.main(["report", "--from", file]) == 0
    assert capsys.readouterr().out.splitlines()[0] == "studies/own/report/report.md"
    assert contents(Path("studies/own/report")) == contents(study / "report")
    assert command.main(["report", "--from", file, "--docs", "docs", "--out", "out"]) == 0
    assert command.main(["report", "docs/own", "--out", "again"]) == 0
    assert contents(Path("again")) == contents(Path("out")) == contents(study / "report")
    capsys.readouterr()
    for arguments, told in (
        (["--from", file, "--studies", str(study.parent)], "own: is a study of that name: say with --out where"),
        (["--from", file, "--episodes", "3"], "--episodes: records have the figures of 2 episodes: leave it out"),
        (["--from", str(study / "study.yaml")], "study.yaml: is no records file: give the records.parquet"),
        (["--from", "nowhere"], "nowhere: cannot be read (No such file or directory)"),
        (["--from", str(study)], "cannot be read (Is a directory)"),
        (["own", "--records", "docs"], "--records: goes with --site"),
    ):
        assert command.main(["report", *arguments]) == BAD_INPUT
        error = capsys.readouterr().err
        assert told in error
        assert error.count("\n") == 1


def goes_wrong(path: Path, number: int) -> bool:
    """Whether a file's records make neither a report nor one line: any other error goes through."""
    try:
        records = parquet_file.unpacked(path.read_bytes())
    except Exception as error:
        return bool(re.search("AssertionError|SystemError", type(error).__name__))
    out = path.with_name("out")
    try:
        whole = path.with_name("whole.parquet")
        parquet_file.write(whole, records)
        write_results(from_records(whole), out)
    except UserError as error:
        return "\n" in str(error)
    return False


@pytest.mark.slow
def test_damaged_records_are_read_or_refused_in_little_memory(study: Path, tmp_path: Path) -> None:
    content = (study / "report" / FILE).read_bytes()
    with confined_pool() as pool:
        changed = [bytes(each) for each in mutants(content, 60, 1)]
        assert pool.submit(each, changed, tmp_path / FILE, goes_wrong).result() == 0


@pytest.mark.parametrize("damage", ["short", "zeros", "footer", "pipe"])
def test_damaged_records_are_one_line_and_nothing_is_written(
    study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], damage: str
) -> None:
    monkeypatch.chdir(tmp_path)
    content = (study / "report" / FILE).read_bytes()
    changed = {"short": content[:-100], "zeros": content[:200] + bytes(3000) + content[3200:],
               "footer": content[:-5] + b"\xff" + content[-4:], "pipe": b""}[damage]  # fmt: skip
    Path(FILE).write_bytes(changed)
    if damage == "pipe":
        Path(FILE).unlink()
        os.mkfifo(FILE)
    assert command.main(["report", "--from", FILE]) == BAD_INPUT
    error = capsys.readouterr().err
    assert error.startswith(f"freemesh: {FILE}: ")
    assert error.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == [FILE]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"name": "../up"}, "holds no study"),
        ({"name": ".."}, "holds no study"),
        ({"study": "[1]"}, "holds no study"),
        ({"study": "study: {seeds: [a]}"}, "study.seeds: must be a list"),
        ({"trainings": []}, "holds no trial"),
        ({"paper_table": "![x](y.png)"}, "holds no study"),
    ],
)
def test_hostile_records_are_one_line(study: Path, tmp_path: Path, change: dict[str, object], told: str) -> None:
    records = parquet_file.read(study / "report" / FILE)
    path = parquet_file.write(tmp_path / FILE, replace(records, **change))
    with pytest.raises(RecordsError, match=re.escape(told)) as error:
        from_records(path)
    assert "\n" not in str(error.value)
    assert str(path) in str(error.value)


@pytest.mark.slow
def test_the_paper_s_table_is_recorded(tmp_path: Path) -> None:
    sets = {"dense": {"env.upsilon": 0.5}, "medium": {"env.upsilon": 1.0}}
    folder = algorithms(tmp_path / "density", {"dense": (60.0, 3e4), "medium": (50.0, 3e4)}, [1], domains=[], sets=sets)
    before = write(folder)
    again = write_results(from_records(before.parent / FILE), tmp_path / "again")
    assert "## The paper's table" in before.read_text()
    assert MADE.sub("", again.read_text()) == MADE.sub("", before.read_text())
