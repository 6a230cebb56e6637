"""A clock that is set back and forth, and a run's folder that is slow, vanishes or cannot be written to any more."""

from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from checkout import ROOT
from test_training import Fake, run

from freemesh_ray.storage.atomic import OutputError
from freemesh_ray.training import checkpoint
from freemesh_ray.training.loop import Status


def evaluations(settings: dict[str, Any]) -> list[dict[str, Any]]:
    """What was found, but not when."""
    path = Path(settings["paths"]["runs"]) / settings["name"] / "evaluations.jsonl"
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    return [{key: value for key, value in row.items() if key != "seconds"} for row in rows]


def test_a_clock_that_is_set_back_and_forth_changes_nothing(
    settings: dict[str, Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    settings["budget"]["minutes"] = 1.0
    run(settings, Fake())
    sound = evaluations(settings)
    drawn, real = random.Random(0), time.time
    monkeypatch.setattr(time, "time", lambda: real() + drawn.choice([-3600.0, 0.0, 3600.0, 1e9]))
    settings["paths"]["runs"] = str(tmp_path / "again")
    statuses: list[Status] = []
    trained = run(settings, Fake(), report=statuses.append)
    assert evaluations(settings) == sound
    assert 0.0 <= trained.progress.seconds < 60.0
    assert all(0.0 <= status.seconds_left <= 60.0 and status.updates_per_second >= 0.0 for status in statuses)


def test_an_hour_that_the_process_did_not_run_costs_nothing_but_the_time_budget(
    settings: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    settings["budget"]["minutes"] = None
    real, asleep = time.monotonic, [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: real() + asleep[0])

    def sleep(status: Status) -> None:
        asleep[0] += 3600.0 if status.env_steps == 500 else 0.0

    trained = run(settings, Fake(), report=sleep)
    assert trained.progress.env_steps == 1000
    assert [row["env_steps"] for row in evaluations(settings)] == [300, 600, 900, 1000]
    assert 3600.0 < trained.progress.seconds < 3700.0


def test_a_slow_folder_costs_time_and_no_checkpoint(settings: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    sync, slow = checkpoint.os.fsync, 0.3
    monkeypatch.setattr(checkpoint.os, "fsync", lambda descriptor: (time.sleep(slow), sync(descriptor)))
    trained = run(settings, Fake())
    found = checkpoint.found(trained.checkpoint.parent)
    assert [path.name for path in found] == ["step_000001000", "step_000000800"]
    assert trained.progress.seconds > 2 * slow


@pytest.mark.parametrize("what", ["removed", "replaced by a file"])
def test_a_folder_that_vanishes_ends_the_training_in_one_line(what: str, settings: dict[str, Any]) -> None:
    folder = Path(settings["paths"]["runs"]) / settings["name"]

    def vanish(status: Status) -> None:
        if status.env_steps == 500:
            shutil.rmtree(folder)
            if what != "removed":
                folder.write_text("")

    with pytest.raises(OutputError, match=str(folder)) as raised:
        run(settings, Fake(), report=vanish)
    assert "\n" not in str(raised.value)


def test_a_checkout_that_is_read_only_is_left_alone(tmp_path: Path) -> None:
    checkout = tmp_path / "checkout"
    checkout.mkdir()
    mounts = [["mount", "--bind", ROOT, checkout], ["mount", "-o", "remount,ro,bind", checkout]]
    if os.geteuid() or any(subprocess.run(mount, capture_output=True).returncode for mount in mounts):
        subprocess.run(["umount", checkout], capture_output=True)
        pytest.skip("a folder can be mounted by root only")
    try:
        tried = subprocess.run(
            [sys.executable, "-m", "freemesh_ray", "train", "--set", "tracking.enabled=false"], cwd=checkout,
            env=os.environ | {"PYTHONPATH": str(checkout), "HOME": "/proc/nowhere"}, capture_output=True, text=True,
            timeout=300,
        )  # fmt: skip
    finally:
        subprocess.run(["umount", checkout], check=True)
    assert tried.returncode == 2, tried.stderr
    assert tried.stderr.splitlines()[-1].endswith(
        "cannot be made (Read-only file system): set paths.runs to another place"
    )
    assert "Traceback" not in tried.stderr
