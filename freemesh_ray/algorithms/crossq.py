"""CrossQ (Bhatt et al. 2024): SAC without target networks; batch normalisation does for its critics what those do.

Critics see (s, a) and (s', a') in one batch, so that both are normalised by the same figures. Each layer of actor and
critics is preceded by batch renormalisation (Ioffe 2017), which at first normalises by the batch alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Self

import numpy as np
import torch
from torch import nn

from freemesh_ray.algorithms import squashed_gaussian
from freemesh_ray.algorithms.networks import Mlp, MlpStack
from freemesh_ray.algorithms.off_policy import OffPolicy, OffPolicyConfig
from freemesh_ray.algorithms.off_policy_learner import Minibatch, OffPolicyLearner
from freemesh_ray.algorithms.sac_module import SACModule
from freemesh_ray.config import ConfigError

#: Share of a batch in the running figures, added to a variance, bounds of the correction, and updates without one.
MOMENTUM, EPSILON, MOST_SCALE, MOST_SHIFT, WARM_UP = 0.01, 1e-3, 3.0, 5.0, 100_000


class BatchRenorm(nn.Module):
    """Normalises each feature by its batch, corrected towards running figures, and by those when not training.

    Args:
        shape: of gain and shift, which broadcasts against a batch: (features,) or (networks, 1, features).
    """

    mean: torch.Tensor
    variance: torch.Tensor
    batches: torch.Tensor

    def __init__(self, *shape: int) -> None:
        super().__init__()
        self.gain, self.shift = nn.Parameter(torch.ones(shape)), nn.Parameter(torch.zeros(shape))
        self.register_buffer("mean", torch.zeros(shape))
        self.register_buffer("variance", torch.ones(shape))
        self.register_buffer("batches", torch.zeros(1))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(.., rows, features) -> the same, in float32 whatever it is of; in training it counts as a batch."""
        x = x.to(self.mean.dtype)
        if not self.training:
            return (x - self.mean) * (self.gain / (self.variance + EPSILON).sqrt()) + self.shift
        keep = len(self.mean.shape) > 1
        mean, variance = x.mean(dim=-2, keepdim=keep), x.var(dim=-2, keepdim=keep, unbiased=False)
        deviation, running = (variance + EPSILON).sqrt(), (self.variance + EPSILON).sqrt()
        warm = (self.batches >= WARM_UP).to(x.dtype)
        scale = 1.0 + warm * ((deviation / running).clamp(1.0 / MOST_SCALE, MOST_SCALE) - 1.0)
        shift = warm * ((mean - self.mean) / running).clamp(-MOST_SHIFT, MOST_SHIFT)
        normal = (x - mean) / deviation * scale.detach() + shift.detach()
        with torch.no_grad():
            self.mean.lerp_(mean, MOMENTUM)
            self.variance.lerp_(variance, MOMENTUM)
            self.batches.add_(1.0)
        return normal * self.gain + self.shift


class RenormalisedMlp(Mlp):
    """An Mlp whose layers are preceded by BatchRenorm."""

    def __init__(self, *sizes: Any) -> None:
        super().__init__(*sizes)
        ones = (1,) * len(self.lead)
        self.norms = nn.ModuleList(BatchRenorm(*self.lead, *ones, weight.shape[-2]) for weight in self.weights)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(batch, inputs) -> (.., batch, outputs)."""
        x = x.expand(*self.lead, *x.shape)
        for i, norm in enumerate(self.norms):
            x = self.layer(self.biases[i], norm(x), self.weights[i])
            x = x.relu() if i + 1 < len(self.weights) else x
        return x


class RenormalisedMlpStack(RenormalisedMlp, MlpStack):
    """Several of them side by side."""


class CrossQModule(SACModule):
    """SAC's module with renormalised actor and critics, and without targets."""

    TARGETED = ()
    ACTOR, CRITIC = RenormalisedMlp, RenormalisedMlpStack


class CrossQLearner(OffPolicyLearner):
    """Updates a CrossQModule; of Adam's averages the first is short (beta1 = 0.5), as the paper has it."""

    BETAS = (0.5, 0.999)

    def optimised(self, module: CrossQModule, config: Any) -> dict[str, tuple[list[torch.Tensor], float]]:
        """Critics, actor and temperature."""
        return {**super().optimised(module, config), "alpha": ([module.log_alpha], config.actor_lr)}

    def losses(self, module: CrossQModule, config: Any, minibatch: Minibatch) -> Iterator[tuple[str, torch.Tensor]]:
        """The critics' over one batch of both states; in its turn the actor's and the temperature's."""
        module.eval()
        obs, actions, rewards, next_obs, discounts, noise = minibatch
        alpha = module.log_alpha.exp().detach()
        with torch.no_grad():
            next_actions, next_log_pi = squashed_gaussian.sample(module.actor(next_obs), noise[1])
        module.critic.train()
        both = module.q(torch.cat([obs, next_obs]), torch.cat([actions, next_actions]))
        module.critic.eval()
        values, next_values = both.chunk(2, dim=-1)
        target = rewards + discounts * (next_values.detach().amin(dim=0) - alpha * next_log_pi)
        yield "critic", (values - target).square().mean(dim=1).sum()

        if self._steps % config.policy_delay == 0:
            module.actor.train()
            new_actions, log_pi = squashed_gaussian.sample(module.actor(obs), noise[0])
            module.actor.eval()
            yield "actor", (alpha * log_pi - module.q(obs, new_actions).amin(dim=0)).mean()
            yield "alpha", -(module.log_alpha * (log_pi.detach() - actions.shape[1])).mean()


class CrossQConfig(OffPolicyConfig):
    """OffPolicyConfig's numbers; the paper's own learning rate is 1e-3, and its critics are wider."""

    NAME = "crossq"
    LEARNER = CrossQLearner
    MODULE = CrossQModule

    def __init__(self, algo_class: type | None = None) -> None:
        super().__init__(algo_class=algo_class or CrossQ)

    def configure(self, config: Mapping[str, Any]) -> Self:
        """OffPolicyConfig's.

        Raises:
            ConfigError: several learners, whose shares of a batch would be normalised apart, or layer normalisation.
        """
        if config["learner"]["layer_norm"]:
            raise ConfigError("learner.layer_norm = true: crossq's critics are normalised by their batches: set false")
        if config["learner"]["count"] > 1:
            count = config["learner"]["count"]
            raise ConfigError(f"learner.count = {count}: crossq normalises whole batches: use 0 or 1")
        return super().configure(config)


class CrossQ(OffPolicy):
    """The algorithm; its networks are exported as plain ones, which do what they do when they are not training."""

    config: CrossQConfig

    def _layers(self, module: Mapping[str, np.ndarray], network: str) -> list[tuple[np.ndarray, np.ndarray]]:
        layers = super()._layers(module, network)
        for i, (weight, bias) in enumerate(layers):
            gain, shift, mean, variance = (
                module[f"{network}.norms.{i}.{name}"] for name in ("gain", "shift", "mean", "variance")
            )
            scale = gain / np.sqrt(variance + EPSILON)
            moved = (shift - mean * scale).reshape(*weight.shape[:-2], 1, -1) @ weight
            layers[i] = scale.reshape(*weight.shape[:-2], -1, 1) * weight, bias + moved.reshape(bias.shape)
        return layers
