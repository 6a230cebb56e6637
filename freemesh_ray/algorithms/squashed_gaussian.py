"""The policy's distribution: a Gaussian squashed by tanh into (-1, 1) (Haarnoja et al. 2018, appendix C).

log pi(a) = log N(u; mean, std) - sum log(1 - tanh(u)^2), with log(1 - tanh(u)^2) = 2 log 2 - 2 log(e^u + e^-u), which
does not overflow.
"""

from __future__ import annotations

import math
from typing import Any

import torch
from ray.rllib.core.distribution.torch.torch_distribution import TorchDistribution

from freemesh_ray.policies.policy import LOG_STD_MAX, LOG_STD_MIN

#: What each component takes from log pi, whatever is drawn: log sqrt(2 pi) + 2 log 2.
CONSTANT = 0.5 * math.log(2.0 * math.pi) + 2.0 * math.log(2.0)


def split(outputs: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """The policy network's output (..., 2 d) as mean and clamped log of the deviation, (..., d) each."""
    mean, log_std = outputs.chunk(2, dim=-1)
    return mean, log_std.clamp(LOG_STD_MIN, LOG_STD_MAX)


def log_density(u: torch.Tensor, noise: torch.Tensor, log_std: torch.Tensor) -> torch.Tensor:
    """log pi of tanh(u), where u = mean + std noise; (..., d) -> (...)."""
    squashing = torch.logaddexp(u, -u)
    return (2.0 * squashing - log_std).addcmul(noise, noise, value=-0.5).sum(dim=-1) - u.shape[-1] * CONSTANT


def sample(outputs: torch.Tensor, noise: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Reparameterised action in (-1, 1), (..., d), and its log density, (...), for standard normal ``noise``."""
    mean, log_std = split(outputs)
    u = torch.addcmul(mean, log_std.exp(), noise)
    return u.tanh(), log_density(u, noise, log_std)


def backward(
    outputs: torch.Tensor,
    noise: torch.Tensor,
    action: torch.Tensor,
    d_action: torch.Tensor,
    d_log_pi: float | torch.Tensor,
) -> torch.Tensor:
    """Gradient of the network's output, (batch, 2 d), through ``sample``.

    With u = mean + std noise and a = tanh(u):  da/du = 1 - a^2,  dlog pi/du = 2 a,  dlog pi/dlog std = -1 besides,
    du/dmean = 1,  du/dlog std = std noise.  Where log std is clamped its gradient is 0.

    Args:
        outputs: of the policy network.
        noise: as given to ``sample``.
        action: as ``sample`` returned it.
        d_action: gradient of the loss by the action, (batch, d).
        d_log_pi: gradient of the loss by each row's log density, the same for all rows; a number or (1,).
    """
    log_std = outputs.chunk(2, dim=-1)[1]
    d_u = d_action * (1.0 - action.square()) + 2.0 * d_log_pi * action
    d_log_std = d_u * log_std.clamp(LOG_STD_MIN, LOG_STD_MAX).exp() * noise - d_log_pi
    inside = (log_std >= LOG_STD_MIN) & (log_std <= LOG_STD_MAX)
    return torch.cat([d_u, d_log_std * inside], dim=-1)


def deterministic(outputs: torch.Tensor) -> torch.Tensor:
    """The squashed mean, (..., d) in [-1, 1]."""
    return split(outputs)[0].tanh()


class SquashedGaussian(TorchDistribution):
    """The same as an RLlib distribution, for its connectors; ``to_deterministic`` squashes the mean, too."""

    def __init__(self, outputs: torch.Tensor) -> None:
        self._outputs = outputs
        super().__init__()

    def _get_torch_distribution(self, *args: Any, **kwargs: Any) -> torch.distributions.Distribution:
        mean, log_std = split(self._outputs)
        return torch.distributions.Normal(mean, log_std.exp())

    def sample(self, *, sample_shape: torch.Size = torch.Size(), **kwargs: Any) -> torch.Tensor:  # noqa: B008
        """An action, without gradient."""
        return self._dist.sample(sample_shape).tanh()

    def rsample(self, *, sample_shape: torch.Size = torch.Size(), **kwargs: Any) -> torch.Tensor:  # noqa: B008
        """An action, with gradient."""
        return self._dist.rsample(sample_shape).tanh()

    def logp(self, value: torch.Tensor, **kwargs: Any) -> torch.Tensor:
        """log pi of actions in (-1, 1), (...,)."""
        limit = 1.0 - 1e-6
        u = torch.atanh(value.clamp(-limit, limit))
        return (self._dist.log_prob(u) + 2.0 * torch.logaddexp(u, -u)).sum(dim=-1) - u.shape[-1] * math.log(4.0)

    def entropy(self, **kwargs: Any) -> torch.Tensor:
        """A one-sample estimate: the squashed density has no closed form."""
        mean, log_std = split(self._outputs)
        noise = torch.randn_like(mean)
        return -log_density(mean + log_std.exp() * noise, noise, log_std)

    def kl(self, other: TorchDistribution, **kwargs: Any) -> torch.Tensor:
        """The divergence of the Gaussians before squashing, which squashing leaves unchanged."""
        return torch.distributions.kl.kl_divergence(self._dist, other._dist).sum(dim=-1)

    @staticmethod
    def required_input_dim(space: Any, **kwargs: Any) -> int:
        """2 d."""
        return 2 * int(math.prod(space.shape))

    @classmethod
    def from_logits(cls, logits: torch.Tensor, **kwargs: Any) -> SquashedGaussian:
        """The distribution of network outputs (..., 2 d)."""
        return cls(logits)

    def to_deterministic(self) -> Any:
        """A distribution whose sample is the squashed mean."""
        from ray.rllib.core.distribution.torch.torch_distribution import TorchDeterministic

        return TorchDeterministic(loc=deterministic(self._outputs))
