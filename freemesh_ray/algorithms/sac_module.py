"""SAC's networks: actor, twin critics, their targets, and the temperature.

The temperature is a parameter of the module, so that it is saved and restored with the weights.
"""

from __future__ import annotations

import torch
from torch import nn

from freemesh_ray.algorithms.actor_critic_module import ActorCriticModule


class SACModule(ActorCriticModule):
    """An ActorCriticModule with log alpha, which begins at the log of ``initial_alpha``."""

    def setup(self) -> None:
        """Build the networks, and the temperature."""
        super().setup()
        if not self.inference_only:
            self.log_alpha = nn.Parameter(torch.log(torch.tensor([float(self.model_config["initial_alpha"])])))

    def get_non_inference_attributes(self) -> list[str]:
        """What acting does not need."""
        return [*super().get_non_inference_attributes(), "log_alpha"]
