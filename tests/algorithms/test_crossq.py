"""CrossQ's normalisation against torch's own, and what it learns."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from learners import ACT, batch, learner, module, update
from ray.rllib.core.columns import Columns

from freemesh_ray import config
from freemesh_ray.algorithms import crossq
from freemesh_ray.algorithms.crossq import BatchRenorm, CrossQConfig
from freemesh_ray.config import ConfigError


def batches(count: int) -> list[torch.Tensor]:
    """(64, 5) rows of unlike means and deviations."""
    random = np.random.default_rng(0)
    size = (64, 5)
    return [
        torch.from_numpy(random.normal(np.arange(5), 1 + np.arange(5), size).astype(np.float32)) for _ in range(count)
    ]


def test_it_is_batch_normalisation_until_it_is_warm() -> None:
    ours, theirs = BatchRenorm(5), torch.nn.BatchNorm1d(5, eps=crossq.EPSILON, momentum=crossq.MOMENTUM)
    for x in batches(20):
        torch.testing.assert_close(ours(x), theirs(x), rtol=1e-4, atol=1e-4)
    ours.eval()
    theirs.eval()
    (x,) = batches(1)
    torch.testing.assert_close(ours(x), theirs(x), rtol=1e-2, atol=1e-2)  # torch counts variances unbiased


def test_it_normalises_by_its_running_figures_when_it_is_warm(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the correction is within its bounds; then training and acting do the same."""
    norm = BatchRenorm(2, 1, 5)
    for x in batches(300):
        norm(x.expand(2, *x.shape))
    monkeypatch.setattr(crossq, "WARM_UP", 100)
    (x,) = batches(1)
    running = norm.mean.clone(), norm.variance.clone()
    trained = norm(x.expand(2, *x.shape))
    norm.mean, norm.variance = running
    torch.testing.assert_close(trained, norm.eval()(x.expand(2, *x.shape)), rtol=1e-3, atol=1e-3)


def test_a_batch_of_its_own_corrects_at_most_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    norm = BatchRenorm(5)
    monkeypatch.setattr(crossq, "WARM_UP", 0)
    x = 1000.0 * batches(1)[0] + 50_000.0
    assert norm(x).abs().max() <= crossq.MOST_SHIFT + crossq.MOST_SCALE * 5.0


@pytest.mark.slow
def test_it_learns_without_targets() -> None:
    """With rewards of -|a - 0.5|^2 and no future the actor goes to 0.5."""
    settings = {"gamma": 0.0, "initial_alpha": 0.01, "actor_lr": 3e-3, "critic_lr": 1e-2, "policy_delay": 1}
    built = learner(CrossQConfig().training(**settings))
    assert not [name for name, _ in module(built).named_children() if name.startswith("target")]
    rows = batch(400)
    rows[Columns.REWARDS][:] = -np.square(rows[Columns.ACTIONS] - 0.5).sum(axis=1)

    def error() -> float:
        with torch.no_grad():
            mean = module(built).eval().actor(torch.from_numpy(rows[Columns.OBS][:100]))[:, :ACT]
        return float((mean.tanh() - 0.5).abs().mean())

    before = error()
    for _ in range(3):
        figures = update(built, rows)
    assert error() < min(0.2, before / 2)
    assert all(np.isfinite(float(figures[name])) for name in ("critic_loss", "actor_loss", "alpha_loss"))


def test_the_policy_waits_for_its_turn() -> None:
    built = learner(CrossQConfig().training(policy_delay=3))
    seen = []
    for _ in range(4):
        before = [parameter.clone() for parameter in module(built).actor.parameters()]
        update(built, batch(1))
        moved = not all(torch.equal(a, b) for a, b in zip(before, module(built).actor.parameters(), strict=True))
        seen.append(moved)
    assert seen == [False, False, True, False]


def test_several_learners_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"learner\.count = 2: crossq normalises whole batches"):
        CrossQConfig().configure(config.load([], ["algorithm=crossq", "learner.count=2"]))
