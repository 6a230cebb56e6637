"""The learner's step against Stable-Baselines3's: the same weights, batches and noise."""

from __future__ import annotations

import copy
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium import spaces
from learners import ACT, BATCH, OBS, batch, learner, module, update
from ray.rllib.core.columns import Columns
from torch import nn

from freemesh_ray.algorithms.ddpg import DDPGConfig
from freemesh_ray.algorithms.networks import Mlp
from freemesh_ray.algorithms.td3 import TD3Config
from freemesh_ray.algorithms.td3_module import TD3Module

STEPS = 7


class Nowhere(gym.Env[np.ndarray, np.ndarray]):
    """An environment that only has spaces."""

    observation_space = spaces.Box(-1, 1, (OBS,))
    action_space = spaces.Box(-1, 1, (ACT,))


def copied(linears: nn.Module, network: Mlp, which: int | None = None) -> None:
    """The weights of a network, or of one of a stack, into torch's layers."""
    layers = [layer for layer in linears if isinstance(layer, nn.Linear)]
    with torch.no_grad():
        for linear, weight, bias in zip(layers, network.weights, network.biases, strict=True):
            linear.weight.copy_((weight if which is None else weight[which]).T)
            linear.bias.copy_(bias if which is None else bias[which, 0])


def stable_baselines(kind: str, ours: TD3Module, rows: dict[str, np.ndarray]) -> Any:
    """Stable-Baselines3's algorithm with our weights, whose replay buffer gives out ``rows`` in order."""
    baselines = pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.logger import Logger
    from stable_baselines3.common.type_aliases import ReplayBufferSamples

    model = getattr(baselines, kind)(
        "MlpPolicy", Nowhere(), learning_rate=3e-4, buffer_size=10, policy_kwargs={"net_arch": [16, 16]}, device="cpu"
    )
    for actor, mu in ((ours.actor, model.actor), (ours.target_actor, model.actor_target)):
        copied(mu.mu, actor)
    for critic, theirs in ((ours.critic, model.critic), (ours.target_critic, model.critic_target)):
        for i, network in enumerate(theirs.q_networks):
            copied(network, critic, i)
    parts = iter(range(STEPS))

    def sample(size: int, env: Any) -> ReplayBufferSamples:
        k = next(parts)
        one = {key: torch.from_numpy(value[k * size : (k + 1) * size]) for key, value in rows.items()}
        return ReplayBufferSamples(
            one[Columns.OBS], one[Columns.ACTIONS], one[Columns.NEXT_OBS],
            one[Columns.TERMINATEDS][:, None], one[Columns.REWARDS][:, None],
        )  # fmt: skip

    model.replay_buffer.sample = sample
    model.set_logger(Logger(None, []))
    return model


@pytest.mark.parametrize(("kind", "config"), [("TD3", TD3Config), ("DDPG", DDPGConfig)])
def test_k_updates_are_those_of_stable_baselines(kind: str, config: type[TD3Config]) -> None:
    built, rows = learner(config()), batch(STEPS)
    start = copy.deepcopy(module(built))
    model = stable_baselines(kind, start, rows)
    torch.manual_seed(0)  # the learner's noise has this seed, too
    model.train(STEPS, BATCH)
    update(built, rows)
    ours, moved = module(built), False
    for network, actor in ((ours.actor, model.actor), (ours.target_actor, model.actor_target)):
        expected = copy.deepcopy(actor.mu)
        copied(expected, network)
        for new, old in zip(expected.parameters(), actor.mu.parameters(), strict=True):
            torch.testing.assert_close(new, old, rtol=1e-5, atol=1e-6)
    for critic, theirs in ((ours.critic, model.critic), (ours.target_critic, model.critic_target)):
        for i, q in enumerate(theirs.q_networks):
            expected = copy.deepcopy(q)
            copied(expected, critic, i)
            for new, old in zip(expected.parameters(), q.parameters(), strict=True):
                torch.testing.assert_close(new, old, rtol=1e-5, atol=1e-6)
    for new, old in zip(ours.parameters(), start.parameters(), strict=True):
        moved |= bool((new - old).abs().max() > 1e-4)
    assert moved


def test_actor_and_targets_wait_for_the_critics() -> None:
    built = learner(TD3Config().training(policy_delay=3))
    start = copy.deepcopy(module(built).state_dict())
    for step in range(1, 7):
        update(built, batch(1, seed=step))
        now = module(built).state_dict()
        changed = {name.split(".")[0] for name in now if not torch.equal(now[name], start[name])}
        assert changed == ({"critic"} if step % 3 else {"critic", "actor", "target_actor", "target_critic"})
        start = copy.deepcopy(now)


def test_between_two_steps_of_the_actor_the_loss_of_its_last_one_is_told() -> None:
    """Of a figure that was told once, RLlib tells a nan where there is no new one, and a nan ends the training."""
    built = learner(TD3Config().training(policy_delay=4))
    losses = [update(built, batch(1, seed=step)).get("actor_loss") for step in range(1, 9)]
    assert losses[:3] == [None] * 3
    told = [float(loss) for loss in losses[3:]]
    assert np.isfinite(told).all()
    assert told == [told[0]] * 4 + [told[4]]
    assert told[4] != told[0]
    restored = learner(TD3Config().training(policy_delay=4), seed=1)
    restored.set_state(built.get_state())
    assert float(update(restored, batch(1))["actor_loss"]) == told[-1]


def test_exploration_is_clipped_gaussian_noise_on_the_action() -> None:
    td3 = module(learner(TD3Config().training(exploration_noise=0.3)))
    obs, noise = torch.randn(50, OBS), torch.randn(50, ACT) * 3
    with torch.no_grad():
        expected = (td3.actor(obs).tanh() + 0.3 * noise).clamp(-1, 1)
        torch.testing.assert_close(td3.explore(obs, noise), expected)
    assert (expected.abs() == 1).any()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"exploration_noise": -0.1}, "exploration_noise"),
        ({"policy_delay": 0}, "policy_delay"),
        ({"updates_per_step": 0.0}, "updates_per_step"),
    ],
)
def test_settings_out_of_range_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        TD3Config().environment("Pendulum-v1").training(**settings).validate()
