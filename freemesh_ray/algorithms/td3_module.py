"""A deterministic actor and its critics as an RLlib RLModule: what TD3 and DDPG learn."""

from __future__ import annotations

import math
from typing import Any

import torch
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.apis import InferenceOnlyAPI
from ray.rllib.core.rl_module.torch.torch_rl_module import TorchRLModule

from freemesh_ray.algorithms.networks import Mlp, MlpStack
from freemesh_ray.algorithms.squashed_gaussian import SquashedGaussian
from freemesh_ray.policies.policy import LOG_STD_MIN


def log_deviation(noise: float) -> float:
    """Log of the exploration's deviation, for where the policy is written as a squashed Gaussian.

    There the noise is added before the tanh, in ``TD3Module.explore`` after it. Where an action is near the middle of
    its range the two are the same; towards the ends the squashed noise is the smaller.
    """
    return math.log(noise) if noise > math.exp(LOG_STD_MIN) else LOG_STD_MIN


class TD3Module(TorchRLModule, InferenceOnlyAPI):
    """mu_phi = tanh of the actor, its critics Q_theta1 .. Q_thetak, and the targets of all.

    ``model_config``: ``hidden``, the units of each hidden layer of every network; ``critics``, k;
    ``exploration_noise``, deviation of the noise that is added to the actions.
    """

    def setup(self) -> None:
        """Build the networks from the spaces and ``model_config``."""
        torch.set_num_threads(1)
        observation_size = int(self.observation_space.shape[0])
        action_size = int(self.action_space.shape[0])
        hidden, critics = list(self.model_config["hidden"]), int(self.model_config["critics"])
        self.actor = Mlp(observation_size, hidden, action_size)
        if not self.inference_only:
            self.critic = MlpStack(critics, observation_size + action_size, hidden, 1)
            self.target_actor = Mlp(observation_size, hidden, action_size)
            self.target_critic = MlpStack(critics, observation_size + action_size, hidden, 1)
            for target, network in ((self.target_actor, self.actor), (self.target_critic, self.critic)):
                target.load_state_dict(network.state_dict())
                target.requires_grad_(False)
        self.action_dist_cls = SquashedGaussian

    def get_non_inference_attributes(self) -> list[str]:
        """What acting does not need."""
        return ["critic", "target_actor", "target_critic"]

    def explore(self, obs: torch.Tensor, noise: torch.Tensor) -> torch.Tensor:
        """Actions to collect experience with, (batch, action size), for standard normal ``noise`` of that shape."""
        return (self.actor(obs).tanh() + self.model_config["exploration_noise"] * noise).clamp(-1.0, 1.0)

    def _forward(self, batch: dict[str, Any], **kwargs: Any) -> dict[str, Any]:
        mean = self.actor(batch[Columns.OBS])
        log_std = torch.full_like(mean, log_deviation(self.model_config["exploration_noise"]))
        return {Columns.ACTION_DIST_INPUTS: torch.cat([mean, log_std], dim=-1)}
