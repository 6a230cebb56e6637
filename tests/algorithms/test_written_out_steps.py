"""The steps with gradients written out, against automatic differentiation of the losses as the papers print them."""

from __future__ import annotations

import copy
from typing import Any

import pytest
import torch
from learners import batch, learner, module
from ray.rllib.policy.sample_batch import DEFAULT_POLICY_ID

from freemesh_ray.algorithms.ddpg import DDPGConfig
from freemesh_ray.algorithms.off_policy import OffPolicyConfig
from freemesh_ray.algorithms.off_policy_learner import OffPolicyLearner
from freemesh_ray.algorithms.sac import SACConfig
from freemesh_ray.algorithms.td3 import TD3Config

MINIBATCHES = 7
CASES = [
    (SACConfig, {}),
    (SACConfig, {"initial_alpha": 2.0, "target_entropy": 1.5, "gamma": 0.8}),
    (SACConfig, {"policy_delay": 3}),
    (TD3Config, {}),
    (TD3Config, {"policy_delay": 3, "target_noise": 1.0, "target_noise_clip": 0.3}),
    (TD3Config, {"policy_delay": 1, "target_noise": 0.0}),
    (DDPGConfig, {}),
]


def updated(
    make_config: type[OffPolicyConfig], settings: dict[str, Any], dtype: torch.dtype, *, reference: bool
) -> tuple[OffPolicyLearner, dict[str, float]]:
    """A learner after ``MINIBATCHES`` steps, written out or the reference's, and its last figures."""
    rates = {"actor_lr": 1e-2, "critic_lr": 1e-2, "tau": 0.3} | ({"alpha_lr": 1e-2} if make_config is SACConfig else {})
    built = learner(make_config().training(**rates, **settings))
    module(built).to(dtype)
    if reference:
        built._step = OffPolicyLearner._step.__get__(built)  # type: ignore[method-assign]
    rows = {key: torch.from_numpy(column).to(dtype) for key, column in batch(MINIBATCHES).items()}
    told: dict[str, float] = {}
    built.metrics.log_dict = lambda figures, **kwargs: told.update(figures)  # type: ignore[method-assign]
    built._update({DEFAULT_POLICY_ID: rows})
    return built, told


@pytest.mark.slow
@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-9), (torch.float32, 1e-3)])
@pytest.mark.parametrize(("make_config", "settings"), CASES)
def test_they_are_the_papers_losses_differentiated(
    make_config: type[OffPolicyConfig], settings: dict[str, Any], dtype: torch.dtype, tolerance: float
) -> None:
    start = copy.deepcopy(module(learner(make_config().training(**settings)))).to(dtype).state_dict()
    ours, figures = updated(make_config, settings, dtype, reference=False)
    theirs, expected = updated(make_config, settings, dtype, reference=True)
    for (name, tensor), wanted in zip(
        module(ours).state_dict().items(), module(theirs).state_dict().values(), strict=True
    ):
        torch.testing.assert_close(
            tensor, wanted, rtol=tolerance, atol=tolerance, msg=lambda text, name=name: f"{name}: {text}"
        )
        assert (tensor - start[name]).abs().max() > 1e-3, name
    assert {"critic_loss", "actor_loss"} <= set(expected)
    assert {name: figures[name] for name in expected} == pytest.approx(expected, rel=tolerance, abs=tolerance)
