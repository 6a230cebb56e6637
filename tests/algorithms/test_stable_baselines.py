"""The learners' steps against Stable-Baselines3's: the same weights, batches and noise."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium import spaces
from learners import ACT, BATCH, OBS, batch, learner, module, update
from ray.rllib.core.columns import Columns
from torch import nn

from freemesh_ray.algorithms.actor_critic_module import ActorCriticModule
from freemesh_ray.algorithms.ddpg import DDPGConfig
from freemesh_ray.algorithms.networks import Mlp
from freemesh_ray.algorithms.off_policy import OffPolicyConfig
from freemesh_ray.algorithms.sac import SACConfig
from freemesh_ray.algorithms.td3 import TD3Config

STEPS = 7


class Nowhere(gym.Env[np.ndarray, np.ndarray]):
    """An environment that only has spaces."""

    observation_space = spaces.Box(-1, 1, (OBS,))
    action_space = spaces.Box(-1, 1, (ACT,))


def linears(*networks: nn.Module) -> list[nn.Linear]:
    """Their linear layers, in order."""
    return [layer for network in networks for layer in network.modules() if isinstance(layer, nn.Linear)]


def same_weights(ours: ActorCriticModule, theirs: Any) -> Iterator[tuple[str, torch.Tensor, torch.Tensor]]:
    """Each weight and bias of our networks and of Stable-Baselines3's model, in one shape and sharing its memory."""
    policy = theirs.policy

    def layers(name: str, network: Mlp, found: list[nn.Linear], which: int | None = None) -> Iterator[Any]:
        """A network's, or those of one of a stack."""
        for i, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
            mine = (weight, bias) if which is None else (weight[which], bias[which, 0])
            heads = found[i:] if i + 1 == len(network.weights) else found[i : i + 1]
            for head, columns in zip(heads, mine[0].chunk(len(heads), dim=1), strict=True):
                yield f"{name}.weights.{i}", columns.T, head.weight
            for head, part in zip(heads, mine[1].chunk(len(heads)), strict=True):
                yield f"{name}.biases.{i}", part, head.bias

    if hasattr(policy.actor, "latent_pi"):
        heads = linears(policy.actor.latent_pi, policy.actor.mu, policy.actor.log_std)
        yield from layers("actor", ours.actor, heads)
        yield "log_alpha", ours.log_alpha, theirs.log_ent_coef
    else:
        yield from layers("actor", ours.actor, linears(policy.actor))
        yield from layers("target_actor", ours.target_actor, linears(policy.actor_target))
    for i, network in enumerate(policy.critic.q_networks):
        yield from layers(f"critic {i}", ours.critic, linears(network), i)
    for i, network in enumerate(policy.critic_target.q_networks):
        yield from layers(f"target_critic {i}", ours.target_critic, linears(network), i)


def stable_baselines(algorithm: str, ours: ActorCriticModule, rows: dict[str, np.ndarray], **settings: Any) -> Any:
    """Stable-Baselines3's algorithm with our weights, whose replay buffer gives out ``rows`` in order."""
    baselines = pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.logger import Logger
    from stable_baselines3.common.type_aliases import ReplayBufferSamples

    model = getattr(baselines, algorithm)(
        "MlpPolicy", Nowhere(), learning_rate=3e-4, buffer_size=10, policy_kwargs={"net_arch": [16, 16]}, device="cpu",
        **settings,
    )  # fmt: skip
    with torch.no_grad():
        for _, mine, theirs in same_weights(ours, model):
            theirs.copy_(mine)
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


@pytest.mark.parametrize(
    ("algorithm", "config", "settings", "tolerance"),
    [
        # It adds 1e-6 to 1 - tanh(u)^2 before it takes the logarithm.
        ("SAC", SACConfig().training(initial_alpha=0.5), {"ent_coef": "auto_0.5"}, 1e-4),
        ("TD3", TD3Config(), {}, 1e-5),
        ("DDPG", DDPGConfig(), {}, 1e-5),
    ],
)
def test_k_updates_are_those_of_stable_baselines(
    algorithm: str, config: OffPolicyConfig, settings: dict[str, Any], tolerance: float
) -> None:
    built, rows = learner(config), batch(STEPS)
    start = copy.deepcopy(module(built))
    model = stable_baselines(algorithm, start, rows, **settings)
    torch.manual_seed(0)  # the learner's noise has this seed, too
    model.train(STEPS, BATCH)
    update(built, rows)
    compared = 0
    for name, ours, theirs in same_weights(module(built), model):
        torch.testing.assert_close(
            ours, theirs, rtol=tolerance, atol=tolerance / 10, msg=lambda text, name=name: f"{name}: {text}"
        )
        compared += ours.numel()
    assert compared == sum(parameter.numel() for parameter in module(built).parameters())
    for (name, new), old in zip(module(built).named_parameters(), start.parameters(), strict=True):
        assert (new - old).abs().max() > 1e-6, name
