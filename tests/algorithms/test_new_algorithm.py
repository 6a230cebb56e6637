"""An algorithm that is one file with losses and one entry trains as those that ship do.

That it trains, exports and goes on bit for bit like them is tested beside them, in test_algorithms.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from fixed_temperature import registered
from learners import ACT, batch, learner, module, update
from ray.rllib.core.columns import Columns

from freemesh_ray import config
from freemesh_ray.algorithms.build import build, config_class
from freemesh_ray.config import ConfigError
from freemesh_ray.local_ray import local_ray
from freemesh_ray.training.job import train

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def fixed() -> Iterator[None]:
    with registered():
        yield


def test_its_settings_are_settings_of_a_configuration(tmp_path: Path) -> None:
    assert config.load()["fixed"] == {"temperature": 0.2}
    file = tmp_path / "own.yaml"
    file.write_text("algorithm: fixed\nfixed:\n  temperature: 0.5\n")
    tree = config.load([file])
    assert (tree["algorithm"], tree["fixed"]["temperature"]) == ("fixed", 0.5)
    assert config_class("fixed")().configure(tree).temperature == 0.5
    for line in ("fixed.temperature=-1", "fixed.temprature=1"):
        with pytest.raises(ConfigError, match=r"fixed\.temperature"):
            config.load([], [line])
    with pytest.raises(ConfigError, match=r"learner\.batch_size = 256 cannot be shared"):
        config.load([file], ["learner.count=3"])
    with pytest.raises(ConfigError, match="temperature"):
        config_class("fixed")().environment("Pendulum-v1").training(temperature=-1.0).validate()


def test_it_learns_what_its_losses_say() -> None:
    """With rewards of -|a - 0.5|^2 and no future the actor goes to 0.5."""
    built = learner(config_class("fixed")().training(gamma=0.0, temperature=0.1, actor_lr=1e-3, critic_lr=1e-2))
    rows = batch(400)
    rows[Columns.REWARDS][:] = -np.square(rows[Columns.ACTIONS] - 0.5).sum(axis=1)

    def error() -> float:
        with torch.no_grad():
            mean = module(built).actor(torch.from_numpy(rows[Columns.OBS][:100]))[:, :ACT]
        return float((mean.tanh() - 0.5).abs().mean())

    assert error() > 0.4
    figures = update(built, rows)
    assert error() < 0.15
    assert all(np.isfinite(float(figures[name])) for name in ("critic_loss", "actor_loss"))


def test_a_training_of_it_goes_on_from_its_checkpoint_to_the_same_policy(tmp_path: Path) -> None:
    def trained(name: str, *, interrupt_at: float = np.inf, resume: bool = False) -> Any:
        made: list[Any] = []
        settings = config.load(
            ["train_smoke"],
            [
                "algorithm=fixed", f"name={name}", f"paths.runs={tmp_path}", "tracking.enabled=false",
                "runners.count=0",
                "learner.hidden=[16, 16]", "learner.warmup_steps=200", "learner.updates_per_step=0.1",
                "budget.env_steps=1200", "budget.minutes=null", "evaluation.interval=600", "checkpoint.interval=400",
            ],
        )  # fmt: skip
        return train(
            settings,
            resume=resume,
            make=lambda tree: made.append(build(tree)) or made[-1],  # type: ignore[func-returns-value]
            interrupted=lambda: made[-1].env_steps >= interrupt_at,
        )

    with local_ray(0):
        whole = trained("whole")
        with pytest.raises(KeyboardInterrupt):
            trained("parts", interrupt_at=700)
        parts = trained("parts", resume=True)
    assert parts.progress.env_steps == whole.progress.env_steps >= 1200
    assert parts.progress.best == whole.progress.best
    for (ours, _), (theirs, _) in zip(parts.policy.layers, whole.policy.layers, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert parts.policy.critic
