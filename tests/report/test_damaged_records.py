"""Settings that stand for too much, and damaged records of runs and studies: one line, or what is whole of them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from mutants import mutants
from recorded_study import algorithms

from envs.errors import BAD_INPUT
from freemesh_ray import config
from freemesh_ray.cli import command as cli
from freemesh_ray.config import ConfigError
from freemesh_ray.report.results import read
from freemesh_ray.studies import definition
from freemesh_ray.studies.completion_mark import finished
from freemesh_ray.studies.study_folder import StudyError, StudyFolder
from freemesh_ray.tracking.journal import Journal, State
from freemesh_ray.training.run_folder import RunFolder

#: Ten of a list of ten of a list ...: 10^10 values in 300 bytes.
LAUGHS = "a0: &a0 [0]\n" + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 11))


@pytest.mark.slow
@pytest.mark.parametrize(("text", "message"), [
    (LAUGHS, "holds more than 100,000 values"),
    ("name: &a [*a]\n", "holds more than 100,000 values"),
    ("name: " + "[" * 5000, "is not valid YAML"),
    ("name: " + "9" * 5000, "name: must be"),
    ("seed: " + "1:" * 9000 + "1", "seed: must be a whole number .* not a number of thousands of digits"),
    ("name: " + "x" * 1_000_001, "is larger than 1,000,000 bytes"),
    ("name: !!python/object/apply:os.system ['touch here']\n", "name: must be"),
])  # fmt: skip
def test_settings_that_stand_for_too_much_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.yaml").write_text(text)
    with pytest.raises(ConfigError, match=message) as caught:
        config.load(["mine.yaml"])
    assert "\n" not in str(caught.value)
    with pytest.raises(ConfigError):
        definition.load("mine.yaml")
    assert not Path("here").exists()


def test_aliases_of_little_are_read(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("learner:\n  hidden: &h [32, 32]\ncurriculum:\n  stages: [T1]\n")
    assert config.load([tmp_path / "mine.yaml"])["learner"]["hidden"] == [32, 32]


def test_a_device_is_no_settings() -> None:
    with pytest.raises(ConfigError, match="is larger than 1,000,000 bytes"):
        config.load(["/dev/zero"])


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """A finished study of one trial."""
    return algorithms(tmp_path / "studies" / "small", {"A": (60.0, 30e3)}, seeds=[1], steps=30_000, domains=[])


def all_of(folder: Path) -> None:
    """Everything that is read of a study's records."""
    for trial in read(folder).trials:
        steps, values = trial.curve("eval_deterministic/return")
        assert len(steps) == len(values)
        assert np.isfinite(steps).all()
        assert trial.env_steps >= 0
        assert isinstance(trial.seconds, float)
        assert isinstance(trial.config, dict)


@pytest.mark.parametrize("name", ["study.yaml", "trials.json", "runs/A-1/evaluations.jsonl", "runs/A-1/config.yaml"])
def test_damaged_studies_are_read_or_are_one_line(study: Path, name: str) -> None:
    path, lines = study / name, []
    for content in mutants(path.read_bytes()[:2000], 40, 0):
        path.write_bytes(content)
        try:
            all_of(study)
        except (ConfigError, StudyError) as error:
            lines.append(str(error))
    assert (0 < len(lines) < 40) == (not name.startswith("runs"))
    assert not any("\n" in line for line in lines)


@pytest.mark.parametrize(
    "line", ["[" * 100_000, "{", '{"env_steps": 1e400}', '{"env_steps": -5}', "[1]", "\udcff", "7"]
)
def test_damaged_evaluations_are_left_out(study: Path, line: str) -> None:
    path = study / "runs/A-1/evaluations.jsonl"
    whole = read(study).trials[0].evaluations
    path.write_bytes(line.encode(errors="surrogateescape") + b"\n" + path.read_bytes())
    assert read(study).trials[0].evaluations == whole
    RunFolder(path.parent).forget_after(10**9)
    assert [json.loads(line) for line in path.read_text().splitlines()] == whole


@pytest.mark.parametrize(
    "text", ["{", "[" * 100_000, "[1]", '[{"label": 1}]', '[{"label": "A", "seed": "x", "run": 3}]']
)
@pytest.mark.parametrize("command", ["sync", "report"])
def test_damaged_lists_of_trials_are_one_line_of_the_command(
    study: Path, text: str, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (study / "trials.json").write_text(text)
    arguments = {"sync": [str(study)], "report": [study.name, "--studies", str(study.parent)]}[command]
    assert cli.main([command, *arguments]) == BAD_INPUT
    error = capsys.readouterr().err
    assert error.startswith(f"freemesh: {study / 'trials.json'}: is not a list of trials")
    assert error.count("\n") == 1


def test_a_damaged_study_is_not_gone_on_with(study: Path) -> None:
    (study / "study.yaml").write_text("[")
    with pytest.raises(ConfigError, match=r"study\.yaml:1: is not valid YAML"):
        StudyFolder(study).claim(definition.load("seeds"), resume=True)
    (study / "trials.json").write_text("7")
    with pytest.raises(StudyError, match="is not a list of trials"):
        StudyFolder(study).read()


@pytest.mark.parametrize("text", ["", "[", "[1]", "7", "[" * 100_000])
def test_a_damaged_end_of_a_training_is_none(tmp_path: Path, text: str) -> None:
    (tmp_path / "finished.json").write_text(text)
    assert finished(RunFolder(tmp_path)) is None


def test_damaged_journals_are_read_or_left_alone(tmp_path: Path) -> None:
    journal = Journal.new(tmp_path, State("sqlite:///none", "experiment"))
    journal.append({"kind": "metrics", "time": 1, "step": 2, "values": {"a": 1.0}})
    journal.release()
    lines, state = journal.path, journal.path.with_suffix(".json")
    with lines.open("ab") as file:
        file.write(b"[" * 100_000 + b"\n\xff\n[1]\n")
    again = Journal.claim(lines, tmp_path)
    assert again is not None
    assert [event.get("step") for event, _ in again.read()] == [2, None, None, None]
    again.release()
    for text in (
        "",
        "[1]",
        "[" * 100_000,
        '{"uri": 1, "experiment": "e"}',
        '{"uri": "u", "experiment": "e", "sent": -1}',
    ):
        state.write_text(text)
        assert Journal.claim(lines, tmp_path) is None
