"""SAC's networks as an RLlib RLModule: actor, twin critics, their targets, and the temperature.

The temperature is a parameter of the module, so that it is saved and restored with the weights.
"""

from __future__ import annotations

from typing import Any

import torch
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.apis import InferenceOnlyAPI
from ray.rllib.core.rl_module.torch.torch_rl_module import TorchRLModule
from torch import nn

from freemesh_ray.algorithms import squashed_gaussian
from freemesh_ray.algorithms.networks import Mlp, MlpStack
from freemesh_ray.algorithms.squashed_gaussian import SquashedGaussian


class SACModule(TorchRLModule, InferenceOnlyAPI):
    """pi_phi, Q_theta1 and Q_theta2, their targets, and log alpha.

    ``model_config``: ``hidden``, the units of each hidden layer of every network; ``initial_alpha``.
    """

    def setup(self) -> None:
        """Build the networks from the spaces and ``model_config``."""
        torch.set_num_threads(1)
        observation_size = int(self.observation_space.shape[0])
        action_size = int(self.action_space.shape[0])
        hidden = list(self.model_config["hidden"])
        self.actor = Mlp(observation_size, hidden, 2 * action_size)
        if not self.inference_only:
            self.critic = MlpStack(2, observation_size + action_size, hidden, 1)
            self.target_critic = MlpStack(2, observation_size + action_size, hidden, 1)
            self.target_critic.load_state_dict(self.critic.state_dict())
            self.target_critic.requires_grad_(False)
            self.log_alpha = nn.Parameter(torch.log(torch.tensor([float(self.model_config["initial_alpha"])])))
        self.action_dist_cls = SquashedGaussian

    def get_non_inference_attributes(self) -> list[str]:
        """What acting does not need."""
        return ["critic", "target_critic", "log_alpha"]

    def explore(self, obs: torch.Tensor, noise: torch.Tensor) -> torch.Tensor:
        """Actions to collect experience with, (batch, action size), for standard normal ``noise`` of that shape."""
        mean, log_std = squashed_gaussian.split(self.actor(obs))
        return (mean + log_std.exp() * noise).tanh()

    def _forward(self, batch: dict[str, Any], **kwargs: Any) -> dict[str, Any]:
        return {Columns.ACTION_DIST_INPUTS: self.actor(batch[Columns.OBS])}
