"""The algorithms: what ``algorithm`` in a configuration can be, and the settings that each has in a section of its own.

A new algorithm is an entry of `ALGORITHMS` and one file in ``freemesh_ray/algorithms``. The file is named here, not
imported: settings are read without Ray and torch.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from envs.types import TINY
from freemesh_ray.config.field import Field


class Hyperparameter(NamedTuple):
    """A setting of one algorithm alone: its default, and what it accepts."""

    default: Any
    accepts: Field


#: Of the learners with a replay buffer.
ACTOR_CRITIC_FIGURES = {
    "critic_loss": ("reward²", "squared error of the critics"),
    "actor_loss": ("reward", "loss of the policy"),
    "q_mean": ("reward", "mean value of the critics"),
}


@dataclass(frozen=True)
class Algorithm:
    """What the platform knows of an algorithm before it runs.

    Attributes:
        config: ``module:class`` of its RLlib configuration, a ``MeshConfig``.
        settings: those of its section, by name; ``defaults.yaml`` holds the same, with their meaning.
        batch: key of how many transitions one update takes: every learner has an equal share of them.
        experience: key of how many transitions those are drawn from: at least as many.
        figures: name -> unit, meaning of what its learner reports and is tracked as ``learner/NAME``.
    """

    config: str
    settings: Mapping[str, Hyperparameter] = field(default_factory=dict)
    batch: str = "learner.batch_size"
    experience: str = "learner.buffer_size"
    figures: Mapping[str, tuple[str, str]] = field(default_factory=lambda: ACTOR_CRITIC_FIGURES)


_EXPLORATION_NOISE = Hyperparameter(0.1, Field(float, 0, 1))

ALGORITHMS: dict[str, Algorithm] = {
    "sac": Algorithm(
        "freemesh_ray.algorithms.sac:SACConfig",
        {
            "target_entropy": Hyperparameter("auto", Field(float, -1000, 1000, words=("auto",))),
            "initial_alpha": Hyperparameter(0.1, Field(float, TINY, 1000)),
            "policy_delay": Hyperparameter(1, Field(int, 1, 1000)),
        },
        figures=ACTOR_CRITIC_FIGURES
        | {
            "alpha_loss": ("nats", "loss of the temperature"),
            "alpha": ("reward/nat", "temperature"),
            "log_pi_mean": ("nats", "mean log-probability of the actions drawn"),
        },
    ),
    "td3": Algorithm(
        "freemesh_ray.algorithms.td3:TD3Config",
        {
            "exploration_noise": _EXPLORATION_NOISE,
            "target_noise": Hyperparameter(0.2, Field(float, 0, 2)),
            "target_noise_clip": Hyperparameter(0.5, Field(float, 0, 2)),
            "policy_delay": Hyperparameter(2, Field(int, 1, 1000)),
        },
    ),
    "ddpg": Algorithm("freemesh_ray.algorithms.ddpg:DDPGConfig", {"exploration_noise": _EXPLORATION_NOISE}),
    "crossq": Algorithm(
        "freemesh_ray.algorithms.crossq:CrossQConfig",
        {
            "initial_alpha": Hyperparameter(0.1, Field(float, TINY, 1000)),
            "policy_delay": Hyperparameter(3, Field(int, 1, 1000)),
        },
        figures=ACTOR_CRITIC_FIGURES | {"alpha_loss": ("nats", "loss of the temperature")},
    ),
    "ppo": Algorithm(
        "freemesh_ray.algorithms.ppo:PPOConfig",
        {
            "rollout_steps": Hyperparameter(2048, Field(int, 1, 10**7)),
            "epochs": Hyperparameter(10, Field(int, 1, 1000)),
            "minibatch_size": Hyperparameter(64, Field(int, 1, 10**7)),
            "clip": Hyperparameter(0.2, Field(float, TINY, 1)),
            "gae_lambda": Hyperparameter(0.95, Field(float, 0, 1)),
            "entropy_coefficient": Hyperparameter(0.0, Field(float, 0, 100)),
            "value_coefficient": Hyperparameter(0.5, Field(float, 0, 100)),
            "max_grad_norm": Hyperparameter(0.5, Field(float, TINY, 10**9)),
        },
        batch="ppo.minibatch_size",
        experience="ppo.rollout_steps",
        figures={
            "policy_loss": ("1", "clipped loss of the policy"),
            "vf_loss": ("reward²", "squared error of the value function"),
            "vf_explained_var": ("share", "variance of the returns that the value function explains"),
            "entropy": ("nats", "entropy of the policy"),
        },
    ),
}


def settings_by_key(algorithms: Mapping[str, Algorithm]) -> dict[str, Hyperparameter]:
    """Every setting of these algorithms by its dotted key."""
    return {
        f"{name}.{key}": setting
        for name, algorithm in algorithms.items()
        for key, setting in algorithm.settings.items()
    }
