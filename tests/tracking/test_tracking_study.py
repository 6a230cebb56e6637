"""What a study on Ray Tune leaves in its store, whose address is relative to the folder that it was started from."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from processes import ROOT

from freemesh_ray.cli.command import main
from freemesh_ray.tracking import mlflow_store, sync

pytestmark = pytest.mark.slow

SETTINGS = {
    "curriculum.stages": ["T1"], "runners.count": 0, "budget.env_steps": 400, "budget.minutes": None,
    "evaluation.interval": 200, "tracking.uri": "sqlite:///mlflow.db",
}  # fmt: skip
RUN = """
import sys
from fake_study import Fake
from freemesh_ray.local_ray import local_ray
from freemesh_ray.studies.definition import load
from freemesh_ray.studies.runner import run
with local_ray(1):
    for path in sys.argv[1:]:
        run(load(path), resume=False, make=Fake)
"""
STUDIES = {"first": {"small": {"learner.batch_size": 8}, "usual": None}, "second": {"same": None}}


@pytest.fixture(scope="module")
def studies(blank_database: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which a study of two trials ran, and another whose only trial is one of them."""
    folder = tmp_path_factory.mktemp("studies")
    shutil.copy(blank_database, folder / "mlflow.db")
    for name, variants in STUDIES.items():
        study = {"title": "A test", "variants": variants, "seeds": [1]}
        (folder / f"{name}.yaml").write_text(yaml.safe_dump({"study": study, "settings": SETTINGS}))
    subprocess.run(
        [sys.executable, "-c", RUN, *(f"{name}.yaml" for name in STUDIES)], check=True, cwd=folder, timeout=300,
        env={**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}", "FAKE_LOG": str(folder / "log")},
    )  # fmt: skip
    return folder


@pytest.fixture
def client(studies: Path) -> Any:
    return mlflow_store.connect(f"sqlite:///{studies / 'mlflow.db'}")


def test_all_that_was_to_be_told_is_in_the_store(studies: Path, client: Any):
    assert sync(studies, f"sqlite:///{studies / 'mlflow.db'}") == 0
    runs = client.search_runs([client.get_experiment_by_name("freemesh").experiment_id])
    names = {run.info.run_id: run.info.run_name for run in runs}
    family = sorted((run.info.run_name, names.get(run.data.tags.get("mlflow.parentRunId"), "")) for run in runs)
    assert family == [("first", ""), ("same-1", "second"), ("second", ""), ("small-1", "first"), ("usual-1", "first")]
    assert {run.info.status for run in runs} == {"FINISHED"}
    trials = {run.info.run_name: run for run in runs if "mlflow.parentRunId" in run.data.tags}
    for name, run in trials.items():
        label, seed = name.split("-")
        asked = {"variant": label, "seed": seed, "algorithm": "sac", "domain": "T1"}
        assert asked.items() <= run.data.tags.items()
        history = client.get_metric_history(run.info.run_id, "eval_deterministic/return")
        assert [point.step for point in history] == [200, 400]
    assert {name: run.data.tags["study"] for name, run in trials.items()} == {
        "small-1": "first", "usual-1": "first", "same-1": "second",
    }  # fmt: skip
    usual, same = trials["usual-1"].data, trials["same-1"].data
    assert same.tags["freemesh.shared_from"] == usual.tags["freemesh.id"]
    assert same.metrics == usual.metrics


def test_a_study_is_delivered_with_its_trials(
    studies: Path, blank_database: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    copy = tmp_path / "copy"
    shutil.copytree(studies, copy)
    shutil.copy(blank_database, tmp_path / "other.db")
    monkeypatch.setenv("FREEMESH_HOME", str(copy))
    assert main(["sync", "studies/first", "--uri", f"sqlite:///{tmp_path / 'other.db'}"]) == 0
    other = mlflow_store.connect(f"sqlite:///{tmp_path / 'other.db'}")
    runs = other.search_runs([other.get_experiment_by_name("freemesh").experiment_id])
    assert {"first", "small-1", "usual-1"} <= {run.info.run_name for run in runs}


@pytest.mark.parametrize("study", STUDIES)
def test_the_best_policy_of_a_study_is_registered(client: Any, study: str):
    version = client.get_model_version_by_alias(f"freemesh-{study}", "best")
    assert client.get_run(version.run_id).info.run_name == study
    assert {"study": study, "algorithm": "sac", "seed": "1"}.items() <= version.tags.items()
