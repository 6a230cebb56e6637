"""TD3 (Fujimoto et al. 2018): a deterministic policy, twin critics, smoothed targets, delayed policy updates."""

from __future__ import annotations

from typing import Any

import numpy as np

from freemesh_ray.algorithms.off_policy import OffPolicy, OffPolicyConfig
from freemesh_ray.algorithms.td3_learner import TD3Learner
from freemesh_ray.algorithms.td3_module import TD3Module, log_deviation


class TD3Config(OffPolicyConfig):
    """The paper's numbers for TD3 itself, OffPolicyConfig's for the rest."""

    NAME = "td3"
    LEARNER = TD3Learner
    MODULE = TD3Module

    def __init__(self, algo_class: type | None = None) -> None:
        super().__init__(algo_class=algo_class or TD3)


class TD3(OffPolicy):
    """The twin delayed deep deterministic policy gradient, and with DDPGConfig the deep deterministic one."""

    config: TD3Config

    def actor_weights(self) -> list[tuple[Any, Any]]:
        """MeshAlgorithm's, as a squashed Gaussian: further outputs that always say the exploration's deviation."""
        *hidden, (weight, bias) = super().actor_weights()
        log_std = np.full_like(bias, log_deviation(self.config.exploration_noise))
        return [*hidden, (np.hstack([weight, np.zeros_like(weight)]), np.append(bias, log_std))]
