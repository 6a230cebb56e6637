"""Where things lie: below the current folder, below FREEMESH_HOME, below the home of who runs a job."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
import yaml

from envs.errors import BAD_INPUT
from freemesh_ray import config
from freemesh_ray.cli import command
from freemesh_ray.config.paths import HOME, JOB, STORE, Paths, pasted, shown
from freemesh_ray.studies.definition import load
from freemesh_ray.studies.plan import variant_plan
from freemesh_ray.studies.runner import planned

STUDY = {"study": {"title": "Two", "seeds": [1], "variants": {"near": {"learner.gamma": 0.9}, "far": None}}}


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty current folder and an environment that says nothing."""
    for variable in (HOME, JOB, STORE):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "user"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def resolved(*sets: str) -> tuple[str, str, str]:
    """Runs, studies and store of the defaults with settings."""
    tree = Paths.from_environment().resolved(config.load([], sets))
    return tree["paths"]["runs"], tree["paths"]["studies"], tree["tracking"]["uri"]


def below(home: Path) -> tuple[str, str, str]:
    return str(home / "runs"), str(home / "studies"), f"sqlite:///{home / 'mlflow.db'}"


def test_everything_lies_below_the_home(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert resolved() == below(here)
    monkeypatch.setenv(JOB, "{}")
    assert resolved() == below(here / "user" / "freemesh")
    monkeypatch.setenv(HOME, "~/shared")
    assert resolved() == below(here / "user" / "shared")
    monkeypatch.setenv(HOME, "shared")
    assert resolved() == below(here / "shared")


def test_what_is_absolute_stays_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(HOME, "/shared")
    sets = ["paths.runs=/a/runs", "paths.studies=b", "tracking.uri=sqlite:////c/mlflow.db"]
    assert resolved(*sets) == ("/a/runs", "/shared/b", "sqlite:////c/mlflow.db")


def test_the_store_is_the_configuration_s_then_the_environment_s(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(STORE, "http://tracking:5000")
    assert resolved()[2] == "http://tracking:5000"
    assert resolved("tracking.uri=https://other")[2] == "https://other"
    monkeypatch.setenv(STORE, "databricks")
    with pytest.raises(config.ConfigError, match=r"MLFLOW_TRACKING_URI: tracking.uri: must be sqlite:///FILE or http"):
        resolved()
    assert resolved("tracking.uri=https://other")[2] == "https://other"


@pytest.mark.parametrize("url", ["s3://bucket/runs", "gs://b", "file:///tmp/x", "hdfs+x://h"])
def test_a_url_is_no_folder(url: str, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for key in ("paths.runs", "paths.studies"):
        with pytest.raises(config.ConfigError, match=f"{key}: must be a folder, not a URL.*{url[:4]}"):
            config.load([], [f"{key}={url}"])
    monkeypatch.setenv(HOME, url)
    with pytest.raises(config.ConfigError, match=f"^{HOME}: .*must be a folder, not a URL.*{url[:4]}"):
        Paths.from_environment()
    assert list(here.iterdir()) == []


def test_settled_again_elsewhere_it_stays(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tree = Paths.from_environment().resolved(config.load())
    monkeypatch.setenv(HOME, "/elsewhere")
    assert Paths.from_environment().resolved(tree) == tree
    (here / "config.yaml").write_text(config.dump(tree))
    assert config.load([here / "config.yaml"]) == tree


def test_a_trial_is_the_same_wherever_it_lies(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its run folder's name is; a study that was read in one place goes on telling of that one."""
    (here / "two.yaml").write_text(yaml.safe_dump(STUDY))
    study = load("two.yaml")
    monkeypatch.setenv(HOME, "/elsewhere")
    there = load(here / "two.yaml")
    assert study.settings_of_all()["paths"]["runs"] == str(here / "runs")
    assert there.settings_of_all()["paths"]["runs"] == "/elsewhere/runs"
    assert planned(there)[0].path == Path("/elsewhere/studies/two")
    assert study.tree() == there.tree()
    ours, theirs = variant_plan(study, {}).trials, variant_plan(there, {}).trials
    assert [trial.folder.path.name for trial in ours.values()] == [trial.folder.path.name for trial in theirs.values()]
    assert {trial.folder.path.parent for trial in theirs.values()} == {Path("/elsewhere/runs")}


def test_the_command_finds_a_study_below_the_home(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(HOME, "/elsewhere")
    assert command.main(["report", "two"]) == BAD_INPUT
    assert "/elsewhere/studies/two" in capsys.readouterr().err


def test_places_are_shown_as_they_can_be_typed(here: Path) -> None:
    assert shown(here / "runs" / "x") == "runs/x"
    assert shown("/elsewhere/x") == "/elsewhere/x"
    assert shown(f"sqlite:///{here}/mlflow.db") == "sqlite:///mlflow.db"
    assert shown("sqlite:////elsewhere/x.db") == "sqlite:////elsewhere/x.db"
    assert shown("http://host:5000") == "http://host:5000"
    for name in ("a b", "it's", "ü?*", "$HOME"):
        assert shlex.split(pasted(here / name / "x")) == [f"{name}/x"]
