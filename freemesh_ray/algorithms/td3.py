"""TD3 (Fujimoto et al. 2018): a deterministic policy, twin critics, smoothed targets, delayed policy updates."""

from __future__ import annotations

from typing import Any

import numpy as np
from ray.rllib.core.rl_module.rl_module import RLModuleSpec

from freemesh_ray.algorithms.off_policy import OffPolicy, OffPolicyConfig
from freemesh_ray.algorithms.td3_learner import TD3Learner
from freemesh_ray.algorithms.td3_module import TD3Module, log_deviation


class TD3Config(OffPolicyConfig):
    """The paper's numbers for TD3 itself, OffPolicyConfig's for the rest.

    Besides OffPolicyConfig's settings: ``exploration_noise`` (deviation of the noise added to the actions),
    ``target_noise`` and ``target_noise_clip`` (deviation and bound of the noise added to the target's actions),
    ``policy_delay`` (critic updates for each update of the actor and the targets), ``critics`` (how many).
    """

    OWN = (
        *OffPolicyConfig.OWN, "replay_buffer_config", "tau", "actor_lr", "critic_lr",
        "exploration_noise", "target_noise", "target_noise_clip", "policy_delay", "critics",
    )  # fmt: skip

    def __init__(self, algo_class: type | None = None) -> None:
        super().__init__(algo_class=algo_class or TD3)
        self.exploration_noise = 0.1
        self.target_noise = 0.2
        self.target_noise_clip = 0.5
        self.policy_delay = 2
        self.critics = 2

    def validate(self) -> None:
        """OffPolicyConfig's checks, and those of the settings above.

        Raises:
            ValueError: a setting out of its range.
        """
        super().validate()
        for name in ("exploration_noise", "target_noise", "target_noise_clip"):
            if getattr(self, name) < 0:
                raise ValueError(f"{name} = {getattr(self, name)}: must be 0 or more")
        for name in ("policy_delay", "critics"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} = {getattr(self, name)}: must be at least 1")

    def get_default_learner_class(self) -> type[TD3Learner]:
        """The lean learner."""
        return TD3Learner

    def get_default_rl_module_spec(self) -> RLModuleSpec:
        """Networks as wide as SAC's."""
        return RLModuleSpec(
            module_class=TD3Module,
            model_config={
                "hidden": list(self.hidden),
                "critics": self.critics,
                "exploration_noise": self.exploration_noise,
            },
        )


class TD3(OffPolicy):
    """The twin delayed deep deterministic policy gradient."""

    config: TD3Config

    @classmethod
    def get_default_config(cls) -> TD3Config:
        """The paper's numbers."""
        return TD3Config()

    def actor_weights(self) -> list[tuple[Any, Any]]:
        """MeshAlgorithm's, as a squashed Gaussian: further outputs that always say the exploration's deviation."""
        *hidden, (weight, bias) = super().actor_weights()
        log_std = np.full_like(bias, log_deviation(self.config.exploration_noise))
        return [*hidden, (np.hstack([weight, np.zeros_like(weight)]), np.append(bias, log_std))]
