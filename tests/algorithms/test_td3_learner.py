"""The learner's step against Stable-Baselines3's: the same weights, batches and noise."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
import torch
from learners import ACT, OBS, batch, learner, module, update

from freemesh_ray.algorithms.td3 import TD3Config


def test_actor_and_targets_wait_for_the_critics() -> None:
    built = learner(TD3Config().training(policy_delay=3))
    start = copy.deepcopy(module(built).state_dict())
    for step in range(1, 7):
        update(built, batch(1, seed=step))
        now = module(built).state_dict()
        changed = {name.split(".")[0] for name in now if not torch.equal(now[name], start[name])}
        assert changed == ({"critic"} if step % 3 else {"critic", "actor", "target_actor", "target_critic"})
        start = copy.deepcopy(now)


def test_exploration_is_clipped_gaussian_noise_on_the_action() -> None:
    td3 = module(learner(TD3Config().training(exploration_noise=0.3)))
    obs, noise = torch.randn(50, OBS), torch.randn(50, ACT) * 3
    with torch.no_grad():
        expected = (td3.actor(obs).tanh() + 0.3 * noise).clamp(-1, 1)
        torch.testing.assert_close(td3.explore(obs, noise), expected)
    assert (expected.abs() == 1).any()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"exploration_noise": -0.1}, "exploration_noise"),
        ({"policy_delay": 0}, "policy_delay"),
        ({"updates_per_step": 0.0}, "updates_per_step"),
    ],
)
def test_settings_out_of_range_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        TD3Config().environment("Pendulum-v1").training(**settings).validate()


@pytest.mark.slow
def test_between_two_steps_of_the_actor_the_loss_of_its_last_one_is_told() -> None:
    """Of a figure that was told once, RLlib tells a nan where there is no new one, and a nan ends the training."""
    built = learner(TD3Config().training(policy_delay=4))
    losses = [update(built, batch(1, seed=step)).get("actor_loss") for step in range(1, 9)]
    assert losses[:3] == [None] * 3
    told = [float(loss) for loss in losses[3:]]
    assert np.isfinite(told).all()
    assert told == [told[0]] * 4 + [told[4]]
    assert told[4] != told[0]
    restored = learner(TD3Config().training(policy_delay=4), seed=1)
    restored.set_state(built.get_state())
    assert float(update(restored, batch(1))["actor_loss"]) == told[-1]
