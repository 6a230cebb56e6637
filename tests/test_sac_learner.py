"""The learner's step against a plain transcription of SAC with torch's own layers and autograd."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
import torch
from gymnasium import spaces
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.policy.sample_batch import DEFAULT_POLICY_ID, MultiAgentBatch, SampleBatch
from torch.nn.functional import mse_loss

from freemesh_ray.algorithms import squashed_gaussian
from freemesh_ray.algorithms.sac import SACConfig
from freemesh_ray.algorithms.sac_learner import SACLearner
from freemesh_ray.algorithms.sac_module import SACModule

OBS, ACT, BATCH = 7, 3, 32


def learner(seed: int = 0, **training: Any) -> SACLearner:
    torch.manual_seed(seed)
    config = SACConfig().training(train_batch_size_per_learner=BATCH, **training).debugging(seed=seed)
    spec = RLModuleSpec(
        module_class=SACModule,
        observation_space=spaces.Box(-1, 1, (OBS,)),
        action_space=spaces.Box(-1, 1, (ACT,)),
        model_config={"hidden": [16, 16], "initial_alpha": 0.5},
    )
    built = SACLearner(config=config, module_spec=spec)
    built.build()
    return built


def batch(count: int, seed: int = 1) -> dict[str, np.ndarray]:
    random, rows = np.random.default_rng(seed), count * BATCH
    return {
        Columns.OBS: random.standard_normal((rows, OBS)).astype(np.float32),
        Columns.ACTIONS: random.uniform(-1, 1, (rows, ACT)).astype(np.float32),
        Columns.REWARDS: random.standard_normal(rows).astype(np.float32),
        Columns.NEXT_OBS: random.standard_normal((rows, OBS)).astype(np.float32),
        Columns.TERMINATEDS: (random.random(rows) < 0.2).astype(np.float32),
    }


def update(built: SACLearner, rows: dict[str, np.ndarray]) -> dict[str, Any]:
    multi = MultiAgentBatch({DEFAULT_POLICY_ID: SampleBatch(rows)}, env_steps=len(rows[Columns.REWARDS]))
    return built.update(batch=multi, timesteps={})


def transcription(module: SACModule, rows: dict[str, np.ndarray], noises: list[torch.Tensor]) -> SACModule:
    """Haarnoja et al. (2018b), algorithm 1, minibatch after minibatch, on a copy of the module."""
    module = copy.deepcopy(module)
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
    built, rows = learner(), batch(5)
    generator = torch.Generator().manual_seed(0)
    noises = [torch.randn((2, BATCH, ACT), generator=generator) for _ in range(5)]
    expected = transcription(built.module[DEFAULT_POLICY_ID], rows, noises)
    update(built, rows)
    for (name, ours), theirs in zip(
        built.module[DEFAULT_POLICY_ID].state_dict().items(), expected.state_dict().values(), strict=True
    ):
        torch.testing.assert_close(ours, theirs, rtol=1e-4, atol=1e-6, msg=lambda text, name=name: f"{name}: {text}")


def test_terminated_transitions_do_not_bootstrap() -> None:
    """With every transition terminal and reward 3, Q goes to 3 whatever the targets say."""
    built, rows = learner(critic_lr=3e-3), batch(400)
    rows[Columns.REWARDS][:], rows[Columns.TERMINATEDS][:] = 3.0, 1.0
    update(built, rows)
    q = built.module[DEFAULT_POLICY_ID].critic(
        torch.cat([torch.from_numpy(rows[Columns.OBS][:64]), torch.from_numpy(rows[Columns.ACTIONS][:64])], 1)
    )
    assert (q - 3.0).abs().mean() < 0.2


def test_a_restored_learner_goes_on_as_the_original() -> None:
    """Weights, optimizers, temperature and the random state of the noise; RLlib's SAC forgets the temperature."""
    built = learner()
    update(built, batch(3))
    state = copy.deepcopy(built.get_state())
    again = learner(seed=9)
    again.set_state(state)
    assert again.module[DEFAULT_POLICY_ID].log_alpha.item() == built.module[DEFAULT_POLICY_ID].log_alpha.item() != 0.5
    for one in (built, again):
        update(one, batch(3, seed=2))
    for ours, theirs in zip(
        built.module[DEFAULT_POLICY_ID].parameters(), again.module[DEFAULT_POLICY_ID].parameters(), strict=True
    ):
        assert torch.equal(ours, theirs)


def test_what_runners_need_is_the_actor_alone() -> None:
    state = learner().module[DEFAULT_POLICY_ID].get_state(inference_only=True)
    assert state
    assert all(name.startswith("actor.") for name in state)


def test_forward_inference_is_deterministic_and_squashed() -> None:
    module = learner().module[DEFAULT_POLICY_ID]
    obs = torch.randn(20, OBS) * 50
    out = module.forward_inference({Columns.OBS: obs})[Columns.ACTION_DIST_INPUTS]
    action = module.get_inference_action_dist_cls().from_logits(out).to_deterministic().sample()
    assert action.abs().max() <= 1.0
    torch.testing.assert_close(action, module.actor(obs)[:, :ACT].tanh())


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
