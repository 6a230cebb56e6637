"""The learner's step against a plain transcription of SAC with torch's own layers and autograd."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
import torch
from learners import ACT, BATCH, OBS, batch, learner, module, update
from ray.rllib.core.columns import Columns
from torch.nn.functional import mse_loss

from freemesh_ray.algorithms import squashed_gaussian
from freemesh_ray.algorithms.sac import SACConfig
from freemesh_ray.algorithms.sac_module import SACModule


def transcription(original: SACModule, rows: dict[str, np.ndarray], noises: list[torch.Tensor]) -> SACModule:
    """Haarnoja et al. (2018b), algorithm 1, minibatch after minibatch, on a copy of the module."""
    module = copy.deepcopy(original)
    critic = torch.optim.Adam(module.critic.parameters(), lr=3e-4)
    actor = torch.optim.Adam(module.actor.parameters(), lr=3e-4)
    temperature = torch.optim.Adam([module.log_alpha], lr=3e-4)
    for k, noise in enumerate(noises):
        obs, actions, rewards, next_obs, terminated = (
            torch.from_numpy(value[k * BATCH : (k + 1) * BATCH]) for value in rows.values()
        )
        alpha = module.log_alpha.exp().item()
        new_actions, log_pi = squashed_gaussian.sample(module.actor(obs), noise[0])
        temperature.zero_grad()
        (-(module.log_alpha * (log_pi.detach() - ACT))).mean().backward()
        temperature.step()

        with torch.no_grad():
            next_actions, next_log_pi = squashed_gaussian.sample(module.actor(next_obs), noise[1])
            q_1, q_2 = module.target_critic(torch.cat([next_obs, next_actions], 1))[..., 0]
            target = rewards + 0.99 * (1 - terminated) * (torch.min(q_1, q_2) - alpha * next_log_pi)
        q_1, q_2 = module.critic(torch.cat([obs, actions], 1))[..., 0]
        critic.zero_grad()
        (0.5 * (mse_loss(q_1, target) + mse_loss(q_2, target))).backward()
        critic.step()

        q_1, q_2 = module.critic(torch.cat([obs, new_actions], 1))[..., 0]
        actor.zero_grad()
        (alpha * log_pi - torch.min(q_1, q_2)).mean().backward()
        actor.step()

        with torch.no_grad():
            for old, new in zip(module.target_critic.parameters(), module.critic.parameters(), strict=True):
                old.mul_(1 - 0.005).add_(0.005 * new)
    return module


def test_k_updates_are_those_of_the_paper() -> None:
    built, rows = learner(SACConfig().training(initial_alpha=0.5)), batch(5)
    generator = torch.Generator().manual_seed(0)
    noises = [torch.randn((2, BATCH, ACT), generator=generator) for _ in range(5)]
    expected = transcription(module(built), rows, noises)
    update(built, rows)
    for (name, ours), theirs in zip(module(built).state_dict().items(), expected.state_dict().values(), strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-4, atol=1e-6, msg=lambda text, name=name: f"{name}: {text}")


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
        ({"n_step": 3}, "n_step"),
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
