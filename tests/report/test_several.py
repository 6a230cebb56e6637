"""Several studies, records and runs in one report."""

from __future__ import annotations

import csv
import json
import re
import shutil
from pathlib import Path

import pytest
import yaml

from envs.errors import BAD_INPUT
from freemesh_ray.cli import command
from freemesh_ray.report.one_study import write, write_results
from freemesh_ray.report.several import together
from freemesh_ray.report.sources import results_of
from tests.recorded_study import algorithms, rows, saturating, write_run


@pytest.fixture
def studies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two studies of three variants each; ``usual`` of the second has two trainings of ``A``, and one more seed."""
    monkeypatch.chdir(tmp_path)
    place = tmp_path / "studies"
    algorithms(place / "one", {"A": (60.0, 30e3), "B": (10.0, 30e3)}, [1, 2, 3], domains=[])
    algorithms(place / "two", {"usual": (60.0, 30e3), "wide": (40.0, 30e3)}, [1, 2, 4], domains=[])
    for study, label, seeds in (("one", "A", [1, 2, 3]), ("two", "usual", [1, 2, 4])):
        path = place / study / "trials.json"
        trials = json.loads(path.read_text())
        for trial in trials:
            if trial["label"] == label:
                run = f"runs/trial-{trial['seed']:012x}-200000"
                (place / study / trial["run"]).rename(place / study / run)
                trial["run"] = run
        path.write_text(json.dumps(trials))
        assert [trial["seed"] for trial in trials][:3] == seeds
    return place


def lines(path: Path) -> list[dict[str, str]]:
    with open(path, encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_variants_of_all_are_compared_and_a_common_training_is_shown_once(
    studies: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command.main(["report", "one", "two"]) == 0
    report = studies / "one+two" / "report"
    assert capsys.readouterr().out.splitlines()[0] == "studies/one+two/report/report.md"
    text = (report / "report.md").read_text()
    assert "- one: A and two: usual: the same training, shown once" in text
    final = lines(report / "final.csv")
    seeds = {label: [row["seed"] for row in final if row["variant"] == label]
             for label in ("one: A", "one: B", "two: wide")}  # fmt: skip
    assert seeds == {"one: A": ["1", "2", "3", "4"], "one: B": ["1", "2", "3"], "two: wide": ["1", "2", "4"]}
    assert len(final) == 10
    pairs = lines(report / "comparisons.csv")
    assert [(row["x"], row["y"]) for row in pairs] == [
        ("one: A", "two: wide"), ("one: A", "one: B"), ("two: wide", "one: B")]  # fmt: skip
    assert all(float(row["p_corrected"]) >= float(row["p_value"]) for row in pairs)
    smallest = min(pairs, key=lambda row: float(row["p_value"]))
    assert float(smallest["p_corrected"]) == pytest.approx(3 * float(smallest["p_value"]))  # Holm over all three
    assert not (report / "records.parquet").exists()


@pytest.mark.slow
def test_records_stand_for_their_study(studies: Path, tmp_path: Path) -> None:
    before = write_results(together([(name, results_of(name, studies)) for name in ("one", "two")]), tmp_path / "a")
    write(studies / "two", docs=tmp_path / "docs")
    shutil.rmtree(studies / "two")
    for given in ("docs/two", "docs/two/records.parquet"):
        now = write_results(
            together([("one", results_of("one", studies)), (given, results_of(given, studies))]), tmp_path / "b"
        )
        for path in before.parent.glob("*.csv"):
            assert (now.parent / path.name).read_bytes() == path.read_bytes()


def test_a_run_is_compared_with_a_study(studies: Path, tmp_path: Path) -> None:
    import numpy as np

    at = np.arange(10_000, 200_001, 10_000)
    found = rows(at, saturating(at, 50.0, 3e4, 1.0, np.random.default_rng(0)))
    write_run(tmp_path / "runs" / "mine", found, None, ["budget.env_steps=200000", "seed=7"])
    assert command.main(["report", "one", "runs/mine", "--out", "both"]) == 0
    (row,) = [row for row in lines(Path("both/final.csv")) if row["variant"] == "mine"]
    assert (row["seed"], row["status"], row["env_steps"]) == ("7", "finished", "200000")
    assert "- mine: a training" in Path("both/report.md").read_text()


def test_two_of_one_name_are_told_apart(studies: Path) -> None:
    shutil.copytree(studies / "one", "other/one")
    merged = together([(name, results_of(name, studies)) for name in ("one", "other/one")])
    assert merged.labels == ["one: A", "one: B", "one (2): B"]  # the run folders of B do not say what was trained


def test_what_cannot_be_compared_is_one_line(studies: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = studies / "two" / "study.yaml"
    tree = yaml.safe_load(path.read_text())
    tree["study"]["metric"] = "eval_stochastic/score"
    path.write_text(yaml.safe_dump(tree))
    for arguments, told in (
        (["one", "two"], "one and two: are judged by different metrics (eval_deterministic/return, eval_stochastic"),
        (["one", "three"], "studies/three: no such study: there are one, two in"),
        (["one", "studies/one/runs/B-1", "--docs", "docs"], "--docs: goes with one study"),
        (["studies/one/runs/B-1"], "is the folder of one training: give two or more"),
    ):
        assert command.main(["report", *arguments]) == BAD_INPUT
        error = capsys.readouterr().err
        assert told in error
        assert error.count("\n") == 1
    assert sorted(path.name for path in studies.iterdir()) == ["one", "two"]
    assert not re.search("report", " ".join(path.name for path in (studies / "one").iterdir()))
