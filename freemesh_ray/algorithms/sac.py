"""SAC (Haarnoja et al. 2018b): RLlib's algorithm with this package's buffer, learner and env runner.

``SACConfig`` states every number of the paper's table; RLlib's own defaults differ from it.
"""

from __future__ import annotations

from ray.rllib.algorithms.sac import SAC as RLlibSAC
from ray.rllib.algorithms.sac import SACConfig as RLlibSACConfig
from ray.rllib.core.rl_module.rl_module import RLModuleSpec

from freemesh_ray.algorithms.off_policy import OffPolicy, OffPolicyConfig
from freemesh_ray.algorithms.sac_learner import SACLearner
from freemesh_ray.algorithms.sac_module import SACModule


class SACConfig(OffPolicyConfig, RLlibSACConfig):
    """Hyperparameters of the paper (table "Training hyperparameters"), and what the paper leaves open."""

    def __init__(self, algo_class: type | None = None) -> None:
        super().__init__(algo_class=algo_class or SAC)
        self.alpha_lr = 3e-4
        self.initial_alpha = 1.0
        self.target_entropy: str | float = "auto"

    def validate(self) -> None:
        """OffPolicyConfig's checks, and one of SAC's own.

        Raises:
            ValueError: a setting that this algorithm would silently ignore.
        """
        super().validate()
        if self.n_step != 1:
            raise ValueError(f"n_step = {self.n_step}: this buffer holds single transitions; use 1")

    def get_default_learner_class(self) -> type[SACLearner]:
        """The lean learner."""
        return SACLearner

    def get_default_rl_module_spec(self) -> RLModuleSpec:
        """The paper's networks."""
        return RLModuleSpec(
            module_class=SACModule,
            model_config={"hidden": list(self.hidden), "initial_alpha": self.initial_alpha},
        )


class SAC(OffPolicy, RLlibSAC):
    """The soft actor-critic."""

    config: SACConfig

    @classmethod
    def get_default_config(cls) -> SACConfig:
        """The paper's hyperparameters."""
        return SACConfig()
