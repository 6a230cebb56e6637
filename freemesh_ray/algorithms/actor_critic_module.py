"""An actor, its critics and their targets as an RLlib RLModule: what is learnt from a replay buffer."""

from __future__ import annotations

import copy
from typing import Any

import torch
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.apis import InferenceOnlyAPI
from ray.rllib.core.rl_module.torch.torch_rl_module import TorchRLModule

from freemesh_ray.algorithms import squashed_gaussian
from freemesh_ray.algorithms.layer_norm import LayerNormMlpStack
from freemesh_ray.algorithms.networks import Mlp, MlpStack
from freemesh_ray.algorithms.normaliser import Normaliser
from freemesh_ray.algorithms.squashed_gaussian import SquashedGaussian


class ActorCriticModule(TorchRLModule, InferenceOnlyAPI):
    """pi_phi, a squashed Gaussian; its critics Q_theta1 .. Q_thetak; and the targets of the critics.

    ``model_config``: ``hidden``, the units of each hidden layer of every network; ``critics``, k; ``normalise``,
    whether the networks see normalised observations (``seen``); ``layer_norm``, whether the critics' hidden layers are
    normalised; and the settings of the algorithm's section in a configuration.
    """

    #: Numbers that the actor says of each component of an action.
    OUTPUTS = 2
    #: What actor and critics are made of.
    ACTOR: type[Mlp] = Mlp
    CRITIC: type[MlpStack] = MlpStack
    #: Networks that have a target: of ``critic`` it is ``target_critic``.
    TARGETED: tuple[str, ...] = ("critic",)

    def setup(self) -> None:
        """Build the networks from the spaces and ``model_config``."""
        torch.set_num_threads(1)
        observation_size = int(self.observation_space.shape[0])
        action_size = int(self.action_space.shape[0])
        hidden, critics = list(self.model_config["hidden"]), int(self.model_config["critics"])
        self.normaliser = Normaliser(observation_size) if self.model_config.get("normalise") else None
        self.actor = self.ACTOR(observation_size, hidden, self.OUTPUTS * action_size)
        if not self.inference_only:
            stack = LayerNormMlpStack if self.model_config.get("layer_norm") else self.CRITIC
            self.critic = stack(critics, observation_size + action_size, hidden, 1)
            for name in self.TARGETED:
                setattr(self, f"target_{name}", copy.deepcopy(getattr(self, name)).requires_grad_(False))
        self.action_dist_cls = SquashedGaussian

    def get_non_inference_attributes(self) -> list[str]:
        """What acting does not need."""
        return ["critic", *(f"target_{name}" for name in self.TARGETED)]

    def seen(self, obs: torch.Tensor) -> torch.Tensor:
        """Observations as actor and critics take them."""
        return obs if self.normaliser is None else self.normaliser(obs)

    def q(self, obs: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """Q_theta1 .. Q_thetak of each row, (k, batch)."""
        return self.critic(torch.cat([obs, actions], dim=1)).squeeze(-1)

    def target_q(self, obs: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
        """The same of the target critics."""
        return self.target_critic(torch.cat([obs, actions], dim=1)).squeeze(-1)

    def explore(self, obs: torch.Tensor, noise: torch.Tensor) -> torch.Tensor:
        """Actions to collect experience with, (batch, action size), for standard normal ``noise`` of that shape."""
        mean, log_std = squashed_gaussian.split(self.actor(self.seen(obs)))
        return (mean + log_std.exp() * noise).tanh()

    def _forward(self, batch: dict[str, Any], **kwargs: Any) -> dict[str, Any]:
        return {Columns.ACTION_DIST_INPUTS: self.actor(self.seen(batch[Columns.OBS]))}
