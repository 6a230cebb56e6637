"""PPO (Schulman et al. 2017): RLlib's advantages and learner with this package's networks and env runner."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Self

from ray.rllib.algorithms.ppo import PPO as RLlibPPO
from ray.rllib.algorithms.ppo import PPOConfig as RLlibPPOConfig
from ray.rllib.algorithms.ppo.torch.ppo_torch_learner import PPOTorchLearner
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.policy.sample_batch import DEFAULT_POLICY_ID
from ray.rllib.utils.metrics import NUM_ENV_STEPS_SAMPLED_LIFETIME, NUM_MODULE_STEPS_TRAINED

from freemesh_ray.algorithms.configured_learner import ConfiguredLearner
from freemesh_ray.algorithms.mesh_algorithm import MeshAlgorithm, MeshConfig
from freemesh_ray.algorithms.ppo_module import PPOModule


class PPOLearner(ConfiguredLearner, PPOTorchLearner):
    """RLlib's PPO learner, configured as the others are."""


class PPOConfig(MeshConfig, RLlibPPOConfig):
    """Stable-Baselines3's numbers; RLlib's own defaults differ from them.

    RLlib clips the value function's loss itself, not its change as the paper does: with returns beyond the bound
    nothing is learnt from the largest errors. Here neither is clipped, and there is no penalty on the divergence.
    """

    def __init__(self, algo_class: type | None = None) -> None:
        super().__init__(algo_class=algo_class or PPO)
        self.lr = 3e-4
        self.train_batch_size_per_learner = 2048
        self.num_epochs = 10
        self.minibatch_size = 64
        self.clip_param = 0.2
        self.lambda_ = 0.95
        self.entropy_coeff = 0.0
        self.vf_loss_coeff = 0.5
        self.vf_clip_param = math.inf
        self.use_kl_loss = False
        self.kl_coeff = 0.0
        self.grad_clip = 0.5
        # The module squashes its actions itself: see PPOModule.
        self.normalize_actions = False
        self.clip_actions = False

    def configure(self, config: Mapping[str, Any]) -> Self:
        """Take over how a configuration tree says to learn; this configuration."""
        ppo, learners = config["ppo"], max(1, config["learner"]["count"])
        return self.training(
            lr=config["learner"]["learning_rate"],
            train_batch_size_per_learner=math.ceil(ppo["rollout_steps"] / learners),
            num_epochs=ppo["epochs"],
            minibatch_size=ppo["minibatch_size"] // learners,
            clip_param=ppo["clip"],
            lambda_=ppo["gae_lambda"],
            entropy_coeff=ppo["entropy_coefficient"],
            vf_loss_coeff=ppo["value_coefficient"],
            grad_clip=ppo["max_grad_norm"],
        )

    def get_default_learner_class(self) -> type[PPOLearner]:
        """RLlib's, configured."""
        return PPOLearner

    def get_default_rl_module_spec(self) -> RLModuleSpec:
        """Networks as wide as SAC's."""
        return RLModuleSpec(module_class=PPOModule, model_config={"hidden": list(self.hidden)})


class PPO(MeshAlgorithm, RLlibPPO):
    """Proximal policy optimisation.

    A checkpoint holds no episodes in flight: after a restore all environments begin new ones.
    """

    config: PPOConfig

    def training_step(self) -> None:
        """One round: episodes of all env runners, then the epochs on them."""
        steps = math.ceil(self.config.total_train_batch_size / max(1, self.config.num_env_runners))
        with self.metrics.log_time(("timers", "collect")):
            self._ask_runners("rollout", steps=steps)
            collected = self._from_runners()
        episodes = [episode for one in collected for episode in one.episodes]
        if not episodes:
            return
        self._count(sum(map(len, episodes)), [ended for one in collected for ended in one.ended])
        with self.metrics.log_time(("timers", "learn")):
            results = self.learner_group.update(
                episodes=episodes,
                timesteps={NUM_ENV_STEPS_SAMPLED_LIFETIME: self.env_steps},
                num_epochs=self.config.num_epochs,
                minibatch_size=self.config.minibatch_size,
                shuffle_batch_per_epoch=self.config.shuffle_batch_per_epoch,
            )
        rows = sum(int(result[DEFAULT_POLICY_ID][NUM_MODULE_STEPS_TRAINED].peek()) for result in results)
        self.updates += rows // (self.config.minibatch_size * max(1, self.config.num_learners))
        self._learnt(results)
        self._publish()

    def critic_weights(self) -> list[tuple[Any, Any]]:
        """None: PPO values states, not actions."""
        return []
