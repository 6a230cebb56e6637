"""What the replaying learners have in common: restored, they go on; what a configuration says holds."""

from __future__ import annotations

import copy

import numpy as np
import pytest
import torch
from learners import BATCH, batch, learner, module, update
from ray.rllib.core.columns import Columns

from freemesh_ray.algorithms.ddpg import DDPGConfig
from freemesh_ray.algorithms.off_policy import OffPolicyConfig
from freemesh_ray.algorithms.sac import SACConfig
from freemesh_ray.algorithms.td3 import TD3Config

pytestmark = pytest.mark.parametrize("config", [SACConfig, TD3Config, DDPGConfig])


@pytest.mark.slow
def test_a_restored_learner_goes_on_as_the_original(config: type[OffPolicyConfig]) -> None:
    """Weights, optimizers, the random state of the noise, and where the delay of the policy stands."""
    built, again = learner(config()), learner(config(), seed=9)
    update(built, batch(3))
    again.set_state(copy.deepcopy(built.get_state()))
    for one in (built, again):
        update(one, batch(3, seed=2))
    for ours, theirs in zip(module(built).parameters(), module(again).parameters(), strict=True):
        assert torch.equal(ours, theirs)


def test_a_restored_learner_leaves_the_state_that_it_was_given_alone(config: type[OffPolicyConfig]) -> None:
    """Several learners on one machine are given the same memory."""
    built, again = learner(config()), learner(config(), seed=9)
    update(built, batch(3))
    given = copy.deepcopy(built.get_state())
    before = copy.deepcopy(given)
    again.set_state(given)
    update(again, batch(3, seed=2))
    for part in ("optimizer", "rl_module"):
        assert given[part]
        np.testing.assert_equal(given[part], before[part])


def test_a_restored_learner_learns_as_it_is_configured(config: type[OffPolicyConfig]) -> None:
    """Not as the one was that wrote the state: at its learning rates, discount and speed of the targets."""
    built = learner(config())
    update(built, batch(2))
    rates = {"actor_lr": 1e-12, "critic_lr": 1e-12} | ({"alpha_lr": 1e-12} if config is SACConfig else {})
    again = learner(config().training(gamma=0.0, tau=1.0, **rates))
    again.set_state(copy.deepcopy(built.get_state()))
    before, rows = copy.deepcopy(module(again)), batch(2, seed=2)
    figures = update(again, rows)
    for name in ("actor", "critic"):
        for new, old in zip(getattr(module(again), name).parameters(), getattr(before, name).parameters(), strict=True):
            torch.testing.assert_close(new, old, rtol=0, atol=1e-8)
    for new, old in zip(module(again).target_critic.parameters(), module(again).critic.parameters(), strict=True):
        assert torch.equal(new, old)
    obs, actions, rewards = (
        torch.from_numpy(rows[key][-BATCH:]) for key in (Columns.OBS, Columns.ACTIONS, Columns.REWARDS)
    )
    squares = (before.critic(torch.cat([obs, actions], 1))[..., 0] - rewards).square().mean(1).sum()
    expected = squares * (0.5 if config is SACConfig else 1.0)
    assert float(figures["critic_loss"]) == pytest.approx(expected.item(), rel=1e-5)


def test_terminated_transitions_do_not_bootstrap(config: type[OffPolicyConfig]) -> None:
    """With every transition terminal and reward 3, Q goes to 3 whatever the targets say."""
    built, rows = learner(config().training(critic_lr=3e-3)), batch(400)
    rows[Columns.REWARDS][:], rows[Columns.TERMINATEDS][:] = 3.0, 1.0
    update(built, rows)
    q = module(built).critic(
        torch.cat([torch.from_numpy(rows[Columns.OBS][:64]), torch.from_numpy(rows[Columns.ACTIONS][:64])], 1)
    )
    assert (q - 3.0).abs().mean() < 0.2


def test_what_runners_need_is_the_actor_alone(config: type[OffPolicyConfig]) -> None:
    state = module(learner(config())).get_state(inference_only=True)
    assert state
    assert all(name.startswith("actor.") for name in state)


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
@pytest.mark.parametrize("network", ["actor", "critic", "target_critic"])
@pytest.mark.parametrize("layer", [0, 1, 2])
@pytest.mark.parametrize("value", [float("nan"), -float("nan"), float("inf")])
def test_a_weight_that_is_no_number_is_told(
    config: type[OffPolicyConfig], precision: str, network: str, layer: int, value: float
) -> None:
    """Though a ReLU may make 0 of what comes of it: a loss that is no number ends the training."""
    built = learner(config().training(precision=precision))
    with torch.no_grad():
        getattr(module(built), network).weights[layer][..., 0, 0] = value
    figures = update(built, batch(4))
    assert not all(np.isfinite(float(figure)) for name, figure in figures.items() if name.endswith("_loss"))
