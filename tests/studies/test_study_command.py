"""The whole path of a study as its user walks it: real algorithms, Ray Tune, MLflow, report, registered policy."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

STUDY = """study:
  title: Two algorithms
  seeds: [1]
  domains: [T1, D4]
  variants:
    SAC:
    TD3: {algorithm: td3}
settings:
  curriculum.stages: [T1]
  runners.count: 0
"""


def test_from_the_file_to_the_report_and_the_registered_policy(tmp_path: Path) -> None:
    import mlflow

    (tmp_path / "two.yaml").write_text(STUDY)
    command = [sys.executable, "-m", "freemesh_ray", "study", "two.yaml", "--smoke"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=500)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "2 trials of 2,048 env steps" in done.stdout
    assert "2 finished" in done.stdout
    assert "Traceback" not in done.stderr

    folder = tmp_path / "studies" / "two-smoke"
    entries = json.loads((folder / "trials.json").read_text())
    assert [(entry["label"], entry["status"]) for entry in entries] == [("SAC", "finished"), ("TD3", "finished")]
    for entry in entries:
        run = folder / entry["run"]
        assert {path.name for path in run.iterdir()} >= {"config.yaml", "evaluations.jsonl", "policy.npz", "meshes"}
    report = (folder / "report" / "report.md").read_text()
    assert "# Two algorithms" in report
    assert "D4" in report

    store = f"sqlite:///{tmp_path / 'mlflow.db'}"
    client = mlflow.MlflowClient(store)
    experiment = client.get_experiment_by_name("freemesh")
    runs = {run.info.run_name: run for run in client.search_runs([experiment.experiment_id])}
    assert set(runs) == {"two-smoke", "SAC", "TD3", "SAC-1", "TD3-1"}
    parent = runs.pop("two-smoke")
    for variant in ("SAC", "TD3"):  # what its seeds have in common
        curve = client.get_metric_history(runs.pop(variant).info.run_id, "iqm/return")
        assert [point.step for point in curve][-1] >= 2048
    assert any(item.path == "report" for item in client.list_artifacts(parent.info.run_id))
    for name, run in runs.items():
        assert run.info.status == "FINISHED"
        assert run.data.tags["mlflow.parentRunId"] == parent.info.run_id
        assert run.data.tags["variant"] == name[:3]
        assert run.data.tags["study"] == "two-smoke"
        steps = [metric.step for metric in client.get_metric_history(run.info.run_id, "eval_deterministic/return")]
        assert steps == sorted(set(steps))
        assert steps[-1] >= 2048
    version = client.get_model_version_by_alias("freemesh-two-smoke", "best")
    assert version.tags["variant"] in ("SAC", "TD3")

    again = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=200)
    assert again.returncode == 2
    assert again.stderr.startswith("freemesh: ")
    assert "add --resume" in again.stderr
