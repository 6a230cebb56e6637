"""Trainings and studies as jobs of a real Ray cluster: a head and two workers, with token authentication."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from cluster import OVER, Cluster, until
from processes import ROOT, Server, mlflow_server, outside
from shrunk_examples import shrunk

from envs.kernels.jit import cache_folder
from freemesh_ray.studies.study_folder import StudyFolder
from freemesh_ray.tracking.provenance import COMMIT

pytestmark = pytest.mark.slow

#: What a checkout does not have, and what no job needs.
LEFT = shutil.ignore_patterns("__pycache__", ".venv", "runs", "mlflow.db*", ".*_cache", ".hypothesis")
TINY = [
    "--config", "train_smoke", "--set", "curriculum.stages=[T1, T2]", "--set", "curriculum.max_stage_steps=1000",
    "--set", "runners.count=2", "--set", "learner.updates_per_step=0.1", "--set", "budget.minutes=null",
]  # fmt: skip
STUDY = {
    "study": {"title": "Two", "seeds": [1, 2], "variants": {"small": None}},
    "settings": {
        "curriculum.stages": ["T1"], "runners.count": 1, "budget": {"env_steps": 600, "minutes": None},
        "env.reward": "plugged_reward:nothing",
        "evaluation": {"interval": 300, "episodes": 1},
        "learner": {"warmup_steps": 300, "updates_per_step": 0.05, "batch_size": 32, "buffer_size": 1000},
    },
}  # fmt: skip


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkout with a study of its user's, whose reward lies elsewhere."""
    folder = Path(shutil.copytree(ROOT, tmp_path_factory.mktemp("checkout") / "freemesh", ignore=LEFT))
    (folder / "two.yaml").write_text(yaml.safe_dump(STUDY))
    (folder.parent / "plug_ins").mkdir()
    (folder.parent / "plug_ins" / "plugged_reward.py").write_text("def nothing(step): return 0.0\n")
    return folder


@pytest.fixture(scope="module")
def user(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The home of who runs the cluster; its jobs share the kernels' machine code with the tests."""
    home = tmp_path_factory.mktemp("user")
    cache = home / ".cache" / "freemesh"
    cache.mkdir(parents=True)
    for package in ("envs", "freemesh_ray"):
        kernels = Path(cache_folder(ROOT / package))
        kernels.mkdir(parents=True, exist_ok=True)
        (cache / kernels.name).symlink_to(kernels)
    return home


@pytest.fixture(scope="module")
def tracking(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """An MLflow server with nothing in it."""
    with mlflow_server(tmp_path_factory.mktemp("tracking")) as started:
        yield started


@pytest.fixture(scope="module")
def cluster(user: Path) -> Iterator[Cluster]:
    with Cluster(2, HOME=str(user)) as started:
        yield started


def submit(cluster: Cluster, checkout: Path, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """``freemesh submit`` from a checkout; the cluster's address and token are in its environment."""
    path = f"{checkout}:{checkout.parent / 'plug_ins'}"
    return subprocess.run(
        [sys.executable, "-m", "freemesh_ray", "submit", *arguments], cwd=checkout, capture_output=True, text=True,
        env=outside() | {"PYTHONPATH": path} | cluster.environment | variables, timeout=300,
    )  # fmt: skip


def runs_of(served: Server) -> dict[str, Any]:
    """The runs that the MLflow server has: name -> run."""
    import mlflow

    client = mlflow.MlflowClient(served.url)
    experiment = client.get_experiment_by_name("freemesh")
    return {run.info.run_name: run for run in client.search_runs([experiment.experiment_id])}


def test_a_training_is_stopped_and_goes_on_when_it_is_submitted_again(
    cluster: Cluster, checkout: Path, user: Path, tracking: Server
) -> None:
    line = ["--tracking", tracking.url, "--", "train", *TINY, "--set"]
    done = submit(cluster, checkout, "--no-wait", "--submission-id", "first", *line, "budget.env_steps=1e9")
    assert done.returncode == 0, done.stdout + done.stderr
    until(lambda: " step " in cluster.logs("first") or cluster.status("first") in OVER, 300, cluster.trouble)
    assert cluster.status("first") == "RUNNING", cluster.logs("first")

    # The driver and its two runners have a core each: both workers, and the head, which has none, not.
    runners = cluster.actors("EnvRunner")
    assert sum(map(len, runners.values())) == 2
    assert {*runners, *cluster.actors("JobSupervisor")} == {"worker-0", "worker-1"}

    assert cluster.ray("job", "stop", "first").returncode == 0
    assert cluster.status("first") == "STOPPED"
    stopped = cluster.logs("first")
    assert "\r" not in stopped
    assert re.search(r"^T\d  step [\d,]+/1,000,000,000  return ", stopped, re.M)
    (at,) = re.findall(r"interrupted at ([\d,]+) steps; saved", stopped)
    run = user / "freemesh" / "runs" / "smoke"  # in its user's home, not in the copy of the code
    saved = max((run / "checkpoints").iterdir())
    assert saved.name == f"step_{int(at.replace(',', '')):09}"

    end = int(at.replace(",", "")) + 2000
    done = submit(cluster, checkout, *line, f"budget.env_steps={end}")
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"going on from {saved} ({at} steps" in done.stdout
    assert f"compare     {tracking.url}" in done.stdout
    assert "stage T1 -> T2" in stopped + done.stdout
    tracked = runs_of(tracking)["smoke"]
    assert tracked.info.status == "FINISHED"
    assert tracked.data.metrics["train/stage"] == 1
    assert tracked.data.params["paths.runs"] == str(run.parent)
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=checkout, capture_output=True, text=True).stdout.strip()
    assert tracked.data.tags.get(COMMIT, "").startswith(head)


def test_a_study_s_trials_run_on_the_workers_and_are_children_in_mlflow(
    cluster: Cluster, checkout: Path, tmp_path: Path, tracking: Server
) -> None:
    line = ["--home", str(tmp_path), "--tracking", tracking.url, "--", "study", "two.yaml"]
    done = submit(cluster, checkout, *line)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "2 trials of 600 env steps, 2 at a time" in done.stdout
    assert "2 finished" in done.stdout
    study = StudyFolder(tmp_path / "studies" / "two")
    assert [entry.status for entry in study.read()] == ["finished", "finished"]
    assert (study.report / "report.md").is_file()
    rows = [row for entry in study.read() for row in study.run_of(entry).read_evaluations()]
    assert rows
    assert all(row["eval_stochastic/return"] == 0 for row in rows), "the reward came with the job"
    runs = runs_of(tracking)
    parent = runs["two"]
    for name in ("small-1", "small-2"):
        assert runs[name].info.status == "FINISHED"
        assert runs[name].data.tags["mlflow.parentRunId"] == parent.info.run_id

    again = submit(cluster, checkout, *line)
    assert again.returncode == 0, again.stdout + again.stderr
    assert "2 of them trained before" in again.stdout


def test_a_script_of_one_s_own_runs_ray_tune(
    cluster: Cluster, checkout: Path, tmp_path: Path, tracking: Server
) -> None:
    """As docs/python.md has it, on storage that all nodes see."""
    code = shrunk("tune_trainable.py", **{"tracking.enabled": True, "tracking.uri": tracking.url})
    (checkout / "my_study.py").write_text(code.replace("RunConfig(", f"RunConfig(storage_path={str(tmp_path)!r}, "))
    line = ["--runtime-env", "deploy/runtime_env.yaml", "--working-dir", ".", "--", "python", "my_study.py"]
    done = cluster.ray("job", "submit", *line, cwd=checkout)
    assert done.returncode == 0, done.stdout + done.stderr
    best = Path(re.findall(rf"^{tmp_path}/discounts/\S+$", done.stdout, re.M)[-1])
    assert (best / "policy.npz").is_file()
    runs = runs_of(tracking)
    trials = [run for name, run in runs.items() if name.startswith("MeshTrainable")]
    assert sorted(run.data.params["learner.gamma"] for run in trials) == ["0.9", "0.99"]
    assert {run.data.tags["mlflow.parentRunId"] for run in trials} == {runs["discounts"].info.run_id}


def test_without_the_token_there_is_no_job(cluster: Cluster, checkout: Path) -> None:
    before = cluster.jobs()
    done = submit(cluster, checkout, "--", "train", RAY_AUTH_TOKEN="0" * 32)
    assert done.returncode == 2
    assert done.stderr.startswith(f"freemesh: {cluster.url}: asks for another token: set RAY_AUTH_MODE=token")
    assert done.stderr.count("\n") == 1
    bare = urllib.request.Request(f"{cluster.url}/api/jobs/", b'{"entrypoint": "true"}')
    with pytest.raises(urllib.error.HTTPError, match="401"):
        urllib.request.urlopen(bare, timeout=30)
    assert cluster.jobs() == before
