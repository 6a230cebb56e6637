"""Records of studies that want to do harm: what is wrong is one line with the file, what is right is shown as it is."""

from __future__ import annotations

import csv
import json
import os
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from hostile_names import HOSTILE
from recorded_study import algorithms

from envs.errors import UserError
from freemesh_ray import config
from freemesh_ray.cli import command
from freemesh_ray.report.one_study import write
from freemesh_ray.studies.study_folder import StudyFolder
from freemesh_ray.training.run_folder import RunError, RunFolder


@pytest.fixture
def study(tmp_path: Path) -> Path:
    return algorithms(tmp_path / "studies" / "small", {"A": (60.0, 30e3)}, seeds=[1, 2], steps=30_000, domains=[])


@pytest.mark.slow
def test_hostile_records_make_a_harmless_report(
    study: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every text of study.yaml and trials.json that may be any is hostile."""
    monkeypatch.setenv("FREEMESH_HOME", str(study.parent.parent))
    about = config.read_plain(study / "study.yaml")
    about["study"] |= {"title": HOSTILE[10], "paper": HOSTILE[11], "finding": HOSTILE[14]}
    (study / "study.yaml").write_text(config.dump(about))
    records = json.loads((study / "trials.json").read_text())
    for i, name in enumerate(HOSTILE):
        if "\0" not in name:
            records.append({"label": name, "seed": i, "run": f"../{name}", "status": "failed", "error": name,
                            "settings": {name: name}})  # fmt: skip
            records.append({"label": name, "seed": i + 100, "run": records[0]["run"], "status": "finished"})
    (study / "trials.json").write_text(json.dumps(records))
    assert command.main(["report", "small"]) == 0
    shown = capfd.readouterr()
    assert all(line.isprintable() for line in [*shown.out.split("\n"), *shown.err.split("\n")])
    text = (study / "report" / "report.md").read_text(encoding="utf-8")
    assert all(line.isprintable() for line in text.split("\n"))
    outside = re.sub(r"(`+)[^`].*?\1", "", text.replace("\\`", ""))
    assert not re.search(r"<(?!=)", outside)
    assert set(re.findall(r"\]\((.*?)\)", outside)) == {"curves.png", "improvement.png"}
    for path in (study / "report").glob("*.csv"):
        with open(path, newline="", encoding="utf-8") as file:
            for line in csv.reader(file):
                for cell in line:
                    assert not cell.startswith(("=", "@", "+")), path
                    assert not cell.startswith("-") or float(cell) <= 0
    for path in (study / "report").glob("*.svg"):
        ET.parse(path)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["trials.json", "study.yaml", "runs/A-1/evaluations.jsonl"])
@pytest.mark.parametrize("damage", ["sparse", "pipe", "deep", "many", "device"])
def test_files_too_large_or_no_files_are_one_line(study: Path, name: str, damage: str) -> None:
    path = study / name
    path.unlink()
    if damage == "sparse":
        path.touch()
        os.truncate(path, 10**12)
    elif damage == "pipe":
        os.mkfifo(path)
    elif damage == "device":
        path.symlink_to("/dev/zero")
    else:
        path.write_text("[" * 100_000 if damage == "deep" else "[" + "{}," * 2_000_000 + "{}]")
    if name.startswith("runs") and damage in ("deep", "many"):
        assert RunFolder(path.parent).read_evaluations() == []
        return
    with pytest.raises(UserError) as error:
        write(study)
    assert str(path) in str(error.value) or (name == "study.yaml" and "no such study" in str(error.value))
    assert str(error.value).isprintable()
    assert not (study / "report").exists()


@pytest.mark.parametrize("text", [
    "name: [1]\nbudget: {env_steps: many}\nlearner: {updates_per_step: [1]}\nevaluation: {interval: {}}\n",
    "budget: {env_steps: .nan}\nevaluation: {interval: .inf}\n",
    "budget: 7\nlearner: [2]\n",
    "7\n",
])  # fmt: skip
def test_settings_of_a_run_that_are_none_are_left_out(study: Path, text: str) -> None:
    for run in (study / "runs").iterdir():
        (run / "config.yaml").write_text(text)
    assert "env steps a trial" not in write(study).read_text()


def test_evaluations_too_long_are_named(tmp_path: Path) -> None:
    run = RunFolder(tmp_path)
    run.evaluations.touch()
    os.truncate(run.evaluations, 10**12)
    for read in (run.read_evaluations, lambda: run.forget_after(3)):
        with pytest.raises(RunError, match=r"evaluations\.jsonl: is no list of evaluations \(more than"):
            read()
    assert run.evaluations.stat().st_size == 10**12


def test_reasons_of_damage_are_cut_short(study: Path) -> None:
    (study / "trials.json").write_text(json.dumps([{"x" * 10_000: "\x1b[2J"}]))
    with pytest.raises(UserError) as error:
        StudyFolder(study).read()
    assert len(str(error.value)) < 400
