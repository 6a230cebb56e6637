"""DDPG (Lillicrap et al. 2016), with Gaussian exploration: TD3 without what TD3 added."""

from __future__ import annotations

from freemesh_ray.algorithms.td3 import TD3Config


class DDPGConfig(TD3Config):
    """TD3 with one critic, no smoothing of the target and no delay of the policy."""

    NAME = "ddpg"
    CRITICS = 1
    target_noise = 0.0
    policy_delay = 1
