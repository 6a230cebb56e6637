"""An algorithm of one's own: the soft actor-critic with a temperature that is set, not learnt; its losses alone."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

import torch

from freemesh_ray.algorithms import squashed_gaussian
from freemesh_ray.algorithms.actor_critic_module import ActorCriticModule
from freemesh_ray.algorithms.off_policy import OffPolicyConfig
from freemesh_ray.algorithms.off_policy_learner import Minibatch, OffPolicyLearner
from freemesh_ray.config import ALGORITHMS, SCHEMA, Algorithm, Field, Hyperparameter, register


class FixedTemperatureLearner(OffPolicyLearner):
    def losses(
        self, module: ActorCriticModule, config: Any, minibatch: Minibatch
    ) -> Iterator[tuple[str, torch.Tensor]]:
        obs, actions, rewards, next_obs, discounts, noise = minibatch
        with torch.no_grad():
            next_actions, log_pi = squashed_gaussian.sample(module.actor(next_obs), noise[1])
            next_value = module.target_q(next_obs, next_actions).amin(dim=0) - config.temperature * log_pi
            target = rewards + discounts * next_value
        yield "critic", (module.q(obs, actions) - target).square().mean(dim=1).sum()
        new_actions, log_pi = squashed_gaussian.sample(module.actor(obs), noise[0])
        yield "actor", (config.temperature * log_pi - module.q(obs, new_actions).amin(dim=0)).mean()


class FixedTemperatureConfig(OffPolicyConfig):
    NAME = "fixed"
    LEARNER = FixedTemperatureLearner


ENTRY = Algorithm(f"{__name__}:FixedTemperatureConfig", {"temperature": Hyperparameter(0.2, Field(float, 0, 10))})


@contextmanager
def registered() -> Iterator[None]:
    """``algorithm: fixed`` is one, and afterwards none."""
    with patch.dict(ALGORITHMS), patch.dict(SCHEMA):
        register("fixed", ENTRY)
        yield
