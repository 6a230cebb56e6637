"""Learners of the replaying algorithms on their own, and batches for them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from ray.rllib.core.columns import Columns
from ray.rllib.policy.sample_batch import DEFAULT_POLICY_ID, MultiAgentBatch, SampleBatch

from freemesh_ray.algorithms.off_policy import OffPolicyConfig
from freemesh_ray.algorithms.off_policy_learner import STEPS, OffPolicyLearner

OBS, ACT, BATCH = 7, 3, 32


def learner(
    config: OffPolicyConfig,
    seed: int = 0,
    *,
    noise: int | None = None,
    index: int = 0,
    hidden: Sequence[int] = (16, 16),
) -> OffPolicyLearner:
    """The configuration's learner with minibatches of BATCH.

    Args:
        config: what to build.
        seed: of the weights, and of the noise unless ``noise`` is another.
        noise: see above.
        index: which of several learners it is, each with its share of the minibatches.
        hidden: units of its networks' hidden layers.
    """
    torch.manual_seed(seed)
    config.training(train_batch_size_per_learner=BATCH // max(1, config.num_learners), hidden=list(hidden))
    config.debugging(seed=seed if noise is None else noise)
    spec = config.get_default_rl_module_spec()
    spec.observation_space, spec.action_space = spaces.Box(-1, 1, (OBS,)), spaces.Box(-1, 1, (ACT,))
    built = config.get_default_learner_class()(config=config, module_spec=spec)
    built._set_learner_index_and_placement_group(learner_index=index, placement_group=None)
    built.build()
    return built


def module(built: OffPolicyLearner) -> Any:
    """What the learner updates."""
    return built.module[DEFAULT_POLICY_ID]


def batch(count: int, seed: int = 1) -> dict[str, np.ndarray]:
    """``count`` minibatches of random transitions."""
    random, rows = np.random.default_rng(seed), count * BATCH
    return {
        Columns.OBS: random.standard_normal((rows, OBS)).astype(np.float32),
        Columns.ACTIONS: random.uniform(-1, 1, (rows, ACT)).astype(np.float32),
        Columns.REWARDS: random.standard_normal(rows).astype(np.float32),
        Columns.NEXT_OBS: random.standard_normal((rows, OBS)).astype(np.float32),
        Columns.TERMINATEDS: (random.random(rows) < 0.2).astype(np.float32),
        STEPS: np.ones(rows, dtype=np.float32),
    }


def update(built: OffPolicyLearner, rows: dict[str, np.ndarray]) -> dict[str, Any]:
    """All minibatches of ``rows``, in order; the figures."""
    multi = MultiAgentBatch({DEFAULT_POLICY_ID: SampleBatch(rows)}, env_steps=len(rows[Columns.REWARDS]))
    return built.update(batch=multi, timesteps={})[DEFAULT_POLICY_ID]
