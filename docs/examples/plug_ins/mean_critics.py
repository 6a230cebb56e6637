"""An algorithm: SAC with a temperature that is set, whose critics are averaged where SAC takes the least of two.

algorithm: mean_critics:MEAN_CRITICS
mean_critics:
  temperature: 0.05
"""

import torch

from freemesh_ray.algorithms import squashed_gaussian
from freemesh_ray.algorithms.off_policy import OffPolicyConfig
from freemesh_ray.algorithms.off_policy_learner import OffPolicyLearner
from freemesh_ray.config import Algorithm, Field, Hyperparameter


class MeanCriticsLearner(OffPolicyLearner):
    def losses(self, module, config, minibatch):
        obs, actions, rewards, next_obs, discounts, noise = minibatch
        with torch.no_grad():
            next_actions, log_pi = squashed_gaussian.sample(module.actor(next_obs), noise[1])
            next_value = module.target_q(next_obs, next_actions).mean(dim=0) - config.temperature * log_pi
            target = rewards + discounts * next_value
        yield "critic", (module.q(obs, actions) - target).square().mean(dim=1).sum()
        new_actions, log_pi = squashed_gaussian.sample(module.actor(obs), noise[0])
        yield "actor", (config.temperature * log_pi - module.q(obs, new_actions).mean(dim=0)).mean()


class MeanCriticsConfig(OffPolicyConfig):
    NAME = "mean_critics"
    LEARNER = MeanCriticsLearner


MEAN_CRITICS = Algorithm(f"{__name__}:MeanCriticsConfig", {"temperature": Hyperparameter(0.1, Field(float, 0, 10))})
