"""A deterministic actor and its critics: what TD3 and DDPG learn."""

from __future__ import annotations

import math
from typing import Any

import torch
from ray.rllib.core.columns import Columns

from freemesh_ray.algorithms.actor_critic_module import ActorCriticModule
from freemesh_ray.policies.policy import LOG_STD_MIN


def log_deviation(noise: float) -> float:
    """Log of the exploration's deviation, for where the policy is written as a squashed Gaussian.

    There the noise is added before the tanh, in ``TD3Module.explore`` after it. Where an action is near the middle of
    its range the two are the same; towards the ends the squashed noise is the smaller.
    """
    return math.log(noise) if noise > math.exp(LOG_STD_MIN) else LOG_STD_MIN


class TD3Module(ActorCriticModule):
    """mu_phi, tanh of the actor; its critics; and the targets of all.

    ``model_config`` holds ``exploration_noise``, deviation of the noise that is added to the actions.
    """

    OUTPUTS = 1
    TARGETED = ("critic", "actor")

    def explore(self, obs: torch.Tensor, noise: torch.Tensor) -> torch.Tensor:
        """Actions to collect experience with, (batch, action size), for standard normal ``noise`` of that shape."""
        return (self.actor(self.seen(obs)).tanh() + self.model_config["exploration_noise"] * noise).clamp(-1.0, 1.0)

    def _forward(self, batch: dict[str, Any], **kwargs: Any) -> dict[str, Any]:
        mean = self.actor(self.seen(batch[Columns.OBS]))
        log_std = torch.full_like(mean, log_deviation(self.model_config["exploration_noise"]))
        return {Columns.ACTION_DIST_INPUTS: torch.cat([mean, log_std], dim=-1)}
