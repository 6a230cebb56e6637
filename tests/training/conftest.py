"""What tests of the training share: settings of a small one, and a clock."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from freemesh_ray import config
from freemesh_ray.algorithms import awake


@pytest.fixture
def settings(tmp_path: Path) -> dict[str, Any]:
    return config.load(
        ["train_smoke"],
        [
            f"paths.runs={tmp_path / 'runs'}",
            "name=fake",
            "budget.env_steps=1000",
            "evaluation.interval=300",
            "evaluation.episodes=2",
            "checkpoint.interval=400",
            "tracking.enabled=false",
        ],
    )


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time that the loop reads, in seconds."""
    now = [1000.0]
    monkeypatch.setattr(awake.time, "monotonic", lambda: now[0])
    return now
