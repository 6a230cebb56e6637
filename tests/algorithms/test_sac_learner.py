"""The learner's step against a plain transcription of SAC with torch's own layers and autograd."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from learners import ACT, OBS, batch, learner, module, update
from ray.rllib.core.columns import Columns

from freemesh_ray.algorithms.sac import SACConfig


@pytest.mark.slow
def test_a_restored_learner_has_the_temperature() -> None:
    """RLlib's SAC forgets it."""
    built, again = learner(SACConfig()), learner(SACConfig())
    update(built, batch(3))
    again.set_state(built.get_state())
    assert module(again).log_alpha.item() == module(built).log_alpha.item() != 0.0


def test_forward_inference_is_deterministic_and_squashed() -> None:
    sac = module(learner(SACConfig()))
    obs = torch.randn(20, OBS) * 50
    out = sac.forward_inference({Columns.OBS: obs})[Columns.ACTION_DIST_INPUTS]
    action = sac.get_inference_action_dist_cls().from_logits(out).to_deterministic().sample()
    assert action.abs().max() <= 1.0
    torch.testing.assert_close(action, sac.actor(obs)[:, :ACT].tanh())


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"updates_per_step": 0.0}, "updates_per_step"),
        ({"warmup_steps": 0}, "warmup_steps"),
        ({"n_step": 0}, "n_step"),
    ],
)
def test_settings_that_would_be_ignored_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        SACConfig().environment("CartPole-v1").training(**settings).validate()


def test_every_number_of_the_paper_is_the_default() -> None:
    config = SACConfig()
    assert config.replay_buffer_config["capacity"] == 1_000_000
    assert config.train_batch_size_per_learner == 256
    assert config.gamma == 0.99
    assert config.actor_lr == config.critic_lr == config.alpha_lr == 3e-4
    assert config.tau == 5e-3
    assert config.updates_per_step == 1.0
    assert config.hidden == [128, 128, 128]
    assert config.torch_skip_nan_gradients is False
