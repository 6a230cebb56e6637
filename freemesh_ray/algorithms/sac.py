"""SAC (Haarnoja et al. 2018b): RLlib's algorithm with this package's buffer, learner and env runner."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self

from ray.rllib.algorithms.sac import SAC as RLlibSAC
from ray.rllib.algorithms.sac import SACConfig as RLlibSACConfig

from freemesh_ray.algorithms.off_policy import OffPolicy, OffPolicyConfig
from freemesh_ray.algorithms.sac_learner import SACLearner
from freemesh_ray.algorithms.sac_module import SACModule


class SACConfig(OffPolicyConfig, RLlibSACConfig):
    """Every number of the paper's table "Training hyperparameters"; RLlib's own defaults differ from it."""

    NAME = "sac"
    LEARNER = SACLearner
    MODULE = SACModule

    def __init__(self, algo_class: type | None = None) -> None:
        super().__init__(algo_class=algo_class or SAC)
        self.alpha_lr = 3e-4

    def configure(self, config: Mapping[str, Any]) -> Self:
        """OffPolicyConfig's, and the temperature's learning rate."""
        return super().configure(config).training(alpha_lr=config["learner"]["learning_rate"])


class SAC(OffPolicy, RLlibSAC):
    """The soft actor-critic."""

    config: SACConfig
