"""DDPG (Lillicrap et al. 2016), with Gaussian exploration: TD3 without what TD3 added."""

from __future__ import annotations

from freemesh_ray.algorithms.td3 import TD3, TD3Config


class DDPGConfig(TD3Config):
    """TD3's settings with one critic, no smoothing of the target and no delay of the policy."""

    def __init__(self, algo_class: type | None = None) -> None:
        super().__init__(algo_class=algo_class or DDPG)
        self.target_noise = 0.0
        self.policy_delay = 1
        self.critics = 1


class DDPG(TD3):
    """The deep deterministic policy gradient."""

    config: DDPGConfig

    @classmethod
    def get_default_config(cls) -> DDPGConfig:
        """One critic, neither smoothing nor delay."""
        return DDPGConfig()
