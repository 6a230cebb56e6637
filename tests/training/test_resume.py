"""The real main job: killed in mid-training and started again with the same command, it goes on."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import meshio
import numpy as np
import pytest

pytestmark = pytest.mark.slow

COMMAND = [
    sys.executable, "-m", "freemesh_ray", "train", "--config", "train_smoke.yaml", "--resume",
    "--set", "budget.env_steps=4000", "--set", "checkpoint.interval=500", "--set", "evaluation.interval=1000",
]  # fmt: skip


def steps(path: Path) -> int:
    return int(json.loads((path / "progress.json").read_text())["env_steps"])


def test_killed_and_started_again(tmp_path: Path) -> None:
    import mlflow

    run = tmp_path / "runs" / "smoke"
    first = subprocess.Popen(COMMAND, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    give_up = time.monotonic() + 300
    while not (saved := sorted(run.glob("checkpoints/step_*/progress.json"))):
        assert first.poll() is None, "the training ended before it was killed"
        assert time.monotonic() < give_up, "no checkpoint appeared"
        time.sleep(0.05)
    first.send_signal(signal.SIGKILL)
    first.wait()
    at = steps(saved[-1].parent)

    second = subprocess.run(COMMAND, cwd=tmp_path, capture_output=True, text=True, timeout=400)
    assert second.returncode == 0, second.stderr
    assert "going on from" in second.stdout
    resumed = int(second.stdout.split("going on from")[1].split("(")[1].split(" steps")[0].replace(",", ""))
    assert resumed >= at
    assert "T1" in second.stdout
    assert "mlflow ui --backend-store-uri" in second.stdout
    last = sorted(run.glob("checkpoints/step_*"))[-1]
    assert steps(last) >= 4000

    rows = [json.loads(line) for line in (run / "evaluations.jsonl").read_text().splitlines()]
    assert rows[-1]["env_steps"] == steps(last)
    assert (run / "policy.npz").is_file()
    assert (run / "learning_curve.png").is_file()
    for mesh in run.glob("meshes/*.vtu"):
        assert len(meshio.read(mesh).cells_dict["quad"])

    client = mlflow.MlflowClient(f"sqlite:///{tmp_path / 'mlflow.db'}")
    (experiment,) = [e for e in client.search_experiments() if e.name == "freemesh"]
    (tracked,) = client.search_runs([experiment.experiment_id])
    assert tracked.info.status == "FINISHED"
    assert tracked.data.params["learner.gamma"] == "0.99"
    history = client.get_metric_history(tracked.info.run_id, "eval_deterministic/return")
    recorded = [metric.step for metric in history]
    assert sorted(set(recorded)) == sorted(recorded), "an evaluation arrived twice"
    assert recorded[-1] == rows[-1]["env_steps"]
    assert np.isfinite([metric.value for metric in history]).all()
    artifacts = {item.path for item in client.list_artifacts(tracked.info.run_id)}
    assert {"config.yaml", "policy.npz", "learning_curve.png"} <= artifacts
