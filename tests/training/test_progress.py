"""What is told of a training while it runs and at its end: metrics, the progress line, time left, the final table."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_training import Fake
from told import told

from freemesh_ray.algorithms.env_runner import Episode
from freemesh_ray.cli.train import COLUMNS, train_table
from freemesh_ray.mesh_geometry.metrics import measure
from freemesh_ray.tracking import MLflowRun
from freemesh_ray.training import progress_line
from freemesh_ray.training.callback import Callbacks
from freemesh_ray.training.job import train
from freemesh_ray.training.loop import Training
from freemesh_ray.training.progress_line import ProgressLine
from freemesh_ray.training.run_folder import RunFolder
from freemesh_ray.training.status import Status


class Recorder(MLflowRun):
    """Keeps what is recorded: step -> values."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, uri="", experiment="", name="", enabled=False)
        self.recorded: dict[int, dict[str, float]] = {}

    def metrics(self, values: Mapping[str, float], step: int) -> None:
        self.recorded.setdefault(step, {}).update(values)


class Timed(Fake):
    """An iteration takes four seconds of a clock that nothing else moves: 100 env steps, 50 updates, two episodes."""

    def __init__(self, clock: list[float]) -> None:
        super().__init__()
        self.clock = clock

    def actor_weights(self) -> list[tuple[Any, Any]]:
        """A policy that the mesher completes T1 with: it asks for a new vertex on top of V_0, always in vain."""
        return [(np.zeros((15, 6), dtype=np.float32), np.array([0, -9, 0, -9, -9, -9], dtype=np.float32))]

    def train(self) -> dict[str, Any]:
        results = super().train()
        self.clock[0] += 4.0
        self.finished[-1:] = [Episode("T1", 60, 10.0, True, 30, 0.5), Episode("T1", 80, 20.0, False, 50, 0.75)]
        return results


def timed(settings: Mapping[str, Any], clock: list[float], folder: Path) -> tuple[list[Status], Recorder]:
    """What a training of 1,000 steps tells."""
    statuses: list[Status] = []
    recorder = Recorder(folder)
    training = Training(Timed(clock), settings, RunFolder(folder), recorder, Callbacks(told(statuses.append)))
    training.loop()
    return statuses, recorder


def test_what_is_recorded_is_that_of_the_iteration(
    settings: dict[str, Any],
    clock: list[float],
    tmp_path: Path,
) -> None:
    _, recorder = timed(settings, clock, tmp_path)
    assert sorted(recorder.recorded) == list(range(100, 1001, 100))
    for i, (step, values) in enumerate(sorted(recorder.recorded.items()), start=1):
        assert {key: value for key, value in values.items() if not key.startswith("eval")} == {
            "train/stage": 0, "train/updates": 50 * i, "train/seconds": 4.0 * i, "train/updates_per_second": 12.5,
            "train/return": 15.0, "train/completion_rate": 0.5, "train/episode_length": 70.0, "train/elements": 40.0,
            "train/element_quality": 0.625, "learner/alpha": 0.1,
        }  # fmt: skip
        assert any(key.startswith("eval") for key in values) == (step in (300, 600, 900, 1000))


@pytest.mark.parametrize(("minutes", "left"), [
    (None, [36.0, 32.0, 28.0, 24.0, 20.0, 16.0, 12.0, 8.0, 4.0, 0.0]),
    (0.5, [26.0, 22.0, 18.0, 14.0, 10.0, 6.0, 2.0, 0.0]),
])  # fmt: skip
def test_the_time_left_is_that_of_the_budget_which_ends_first(
    minutes: float | None,
    left: list[float],
    settings: dict[str, Any],
    clock: list[float],
    tmp_path: Path,
) -> None:
    settings["budget"]["minutes"] = minutes
    statuses, _ = timed(settings, clock, tmp_path)
    assert [status.seconds_left for status in statuses] == pytest.approx(left)
    assert {status.updates_per_second for status in statuses} == {12.5}
    assert {(status.mean_return, status.completion_rate) for status in statuses} == {(15.0, 0.5)}


@pytest.mark.parametrize(("status", "line"), [
    (Status("T1", 1100, 2000, -1.26, 0.5, 12.4, 3725.0),
     "T1  step 1,100/2,000  return -1.3  done 50%  12 updates/s  1:02:05 left\n"),
    (Status("random", 100, 2_000_000, float("nan"), float("nan"), 0.0, float("inf")),
     "random  step 100/2,000,000  return -  done -  0 updates/s  - left\n"),
])  # fmt: skip
def test_the_progress_line_is_the_status(status: Status, line: str) -> None:
    stream = io.StringIO()
    ProgressLine(stream).on_iteration(status)
    assert stream.getvalue() == line


def test_lines_that_stay_are_rare_and_notes_are_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(progress_line.time, "monotonic", lambda: now[0])
    stream, status = io.StringIO(), Status("T1", 1, 2, 3.0, 1.0, 5.0, 6.0)
    line = ProgressLine(stream)
    for _ in range(31):
        line.on_iteration(status)
        line.on_note("noted")
        now[0] += 1.0
    assert stream.getvalue().count("T1  step") == 3
    assert stream.getvalue().count("noted\n") == 31


@pytest.mark.slow
def test_the_end_tells_raw_and_finished_meshes_and_where_all_lies(
    settings: dict[str, Any],
    clock: list[float],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    settings["tracking"] |= {"enabled": False, "uri": f"sqlite:///{tmp_path / 'mlflow.db'}"}
    result = train(settings, make=lambda _: Timed(clock))
    (stage,) = result.stages
    assert [path.suffix for path in stage.files] == [".png", ".vtu", ".msh", ".inp", ".vtu", ".msh", ".inp"]
    assert all(path.stat().st_size for path in stage.files)
    raw, finished = (measure(stage.meshes[name]) for name in ("raw", "finished"))
    assert finished["eta"] > raw["eta"]

    settings["tracking"]["enabled"] = True
    lines = train_table(result, settings).splitlines()
    cells = [line.split() for line in lines]
    for name, figures in (("raw", raw), ("finished", finished)):
        (row,) = (row for row in cells if row[:2] == ["T1", name])
        assert row[2:] == [format(figures[key], form) for key, _, form in COLUMNS]
    assert "trained 1,000 steps, 500 updates in 0:40 (12 updates/s)" in lines
    assert f"best policy from step {result.progress.best_steps:,}" in lines
    told = {row[0]: row[1:] for row in cells if len(row) > 1}
    assert told["policy"] == ["runs/fake/policy.npz"]
    assert told["checkpoint"] == ["runs/fake/checkpoints/step_000001000"]
    assert told["curve"] == ["runs/fake/learning_curve.png"]
    assert told["meshes"] == ["runs/fake/meshes"]
    assert told["compare"][1:] == ["ui", "--backend-store-uri", "sqlite:///mlflow.db"]
    settings["tracking"]["enabled"] = False
    assert "compare" not in train_table(result, settings)
