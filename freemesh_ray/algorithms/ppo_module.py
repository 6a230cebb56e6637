"""PPO's networks as an RLlib RLModule: actor and state value.

PPO needs the density of actions that were taken, and where a tanh has saturated it cannot be told from the action. So
RLlib keeps and rates the Gaussian's draws u, and only the environment receives tanh(u). The ratio of two policies'
densities is the same for both: the derivative of tanh cancels.
"""

from __future__ import annotations

from typing import Any

import torch
from ray.rllib.core.columns import Columns
from ray.rllib.core.distribution.torch.torch_distribution import TorchDiagGaussian
from ray.rllib.core.rl_module.apis import InferenceOnlyAPI, ValueFunctionAPI
from ray.rllib.core.rl_module.torch.torch_rl_module import TorchRLModule

from freemesh_ray.algorithms import squashed_gaussian
from freemesh_ray.algorithms.networks import Mlp


class PPOModule(TorchRLModule, ValueFunctionAPI, InferenceOnlyAPI):
    """pi_phi before squashing, and V_theta.

    ``model_config``: ``hidden``, the units of each hidden layer of both networks.
    """

    def setup(self) -> None:
        """Build the networks from the spaces and ``model_config``."""
        torch.set_num_threads(1)
        observation_size = int(self.observation_space.shape[0])
        hidden = list(self.model_config["hidden"])
        self.actor = Mlp(observation_size, hidden, 2 * int(self.action_space.shape[0]))
        if not self.inference_only:
            self.value = Mlp(observation_size, hidden, 1)
        self.action_dist_cls = TorchDiagGaussian

    def get_non_inference_attributes(self) -> list[str]:
        """What acting does not need."""
        return ["value"]

    def compute_values(self, batch: dict[str, Any], embeddings: Any = None) -> torch.Tensor:
        """V of each observation, (batch,)."""
        return self.value(batch[Columns.OBS]).squeeze(-1)

    def _forward(self, batch: dict[str, Any], **kwargs: Any) -> dict[str, Any]:
        mean, log_std = squashed_gaussian.split(self.actor(batch[Columns.OBS]))
        return {Columns.ACTION_DIST_INPUTS: torch.cat([mean, log_std], dim=-1)}

    def _forward_inference(self, batch: dict[str, Any], **kwargs: Any) -> dict[str, Any]:
        mean = self._forward(batch)[Columns.ACTION_DIST_INPUTS].chunk(2, dim=-1)[0]
        return {Columns.ACTIONS: mean, Columns.ACTIONS_FOR_ENV: mean.tanh()}

    def _forward_exploration(self, batch: dict[str, Any], **kwargs: Any) -> dict[str, Any]:
        outputs = self._forward(batch)
        distribution = self.action_dist_cls.from_logits(outputs[Columns.ACTION_DIST_INPUTS])
        u = distribution.sample()
        return outputs | {
            Columns.ACTIONS: u,
            Columns.ACTION_LOGP: distribution.logp(u),
            Columns.ACTIONS_FOR_ENV: u.tanh(),
        }
