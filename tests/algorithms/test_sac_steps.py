"""SAC's steps in one kernel against the same steps one by one."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import torch
from learners import BATCH, batch, learner, module, update
from ray.rllib.core.columns import Columns

from freemesh_ray.algorithms import block_products, dot_products, tiles
from freemesh_ray.algorithms.off_policy_learner import OffPolicyLearner
from freemesh_ray.algorithms.sac import SACConfig
from freemesh_ray.algorithms.sac_learner import SACLearner
from freemesh_ray.algorithms.sac_steps import SacSteps

PROCESSORS = {"tiles": tiles, "dot products": dot_products}
FIGURES = ("alpha", "alpha_loss", "log_pi_mean", "critic_loss", "q_mean", "actor_loss")


@pytest.fixture(autouse=True, params=PROCESSORS)
def processor(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every kind of instruction that this processor has."""
    multiplies = PROCESSORS[request.param]
    if not multiplies.available():
        pytest.skip(f"this processor has no {request.param} of bfloat16 numbers")
    monkeypatch.setattr(block_products, "processor", lambda: multiplies.SHAPE)


def built(*, one_by_one: bool = False, **settings: Any) -> OffPolicyLearner:
    """A learner whose networks are compiled."""
    found = learner(SACConfig().training(precision="bfloat16", tau=0.3, **settings), hidden=(64, 64))
    if one_by_one:
        found._descend_all = OffPolicyLearner._descend_all.__get__(found)  # type: ignore[method-assign]
    return found


def weights(found: OffPolicyLearner) -> dict[str, torch.Tensor]:
    """Of all networks, and the temperature."""
    return {name: tensor.clone() for name, tensor in module(found).state_dict().items()}


def part(rows: dict[str, np.ndarray], first: int, last: int) -> dict[str, np.ndarray]:
    """Minibatches of several."""
    return {name: column[first * BATCH : last * BATCH] for name, column in rows.items()}


@pytest.mark.slow
@pytest.mark.parametrize("delay", [1, 2, 3])
def test_they_are_the_steps_one_by_one(delay: int) -> None:
    ours, theirs = built(policy_delay=delay), built(policy_delay=delay, one_by_one=True)
    start = weights(ours)
    for count in (7, 2):  # the second call begins where a turn of the actor's is due, or is not
        told, expected = update(ours, batch(count, seed=count)), update(theirs, batch(count, seed=count))
        for name in FIGURES:
            assert float(told[name]) == pytest.approx(float(expected[name]), rel=1e-3, abs=1e-3), name
    for name, found in weights(ours).items():
        wanted = weights(theirs)[name]
        assert float((found - wanted).norm()) <= 1e-2 * float((wanted - start[name]).norm()) + 1e-6, name
        assert not torch.equal(found, start[name]), name


@pytest.mark.slow
def test_many_in_one_call_are_as_many_calls() -> None:
    rows, ours, theirs = batch(6), built(policy_delay=2), built(policy_delay=2)
    update(ours, rows)
    for i in range(6):
        update(theirs, part(rows, i, i + 1))
    for name, found in weights(ours).items():
        assert torch.equal(found, weights(theirs)[name]), name


@pytest.mark.slow
def test_a_state_is_taken_over_bit_for_bit() -> None:
    """By another, and by one that takes the steps one by one, which goes on alike."""
    rows, ours, other, plain = batch(6), built(), built(), built(one_by_one=True)
    update(ours, part(rows, 0, 3))
    for found in (other, plain):
        found.set_state(ours.get_state())
    for found in (ours, other, plain):
        update(found, part(rows, 3, 6))
    for name, found in weights(ours).items():
        assert torch.equal(found, weights(other)[name]), name
        torch.testing.assert_close(found, weights(plain)[name], rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("column", [Columns.OBS, Columns.REWARDS, Columns.NEXT_OBS])
def test_what_is_no_number_is_told(column: str) -> None:
    rows = batch(2)
    rows[column].reshape(-1)[5] = math.nan
    told = update(built(), rows)
    assert math.isnan(float(told["critic_loss"]))


def counted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The first steps of the calls of the kernel, as they come."""
    calls: list[int] = []
    steps = SacSteps.steps

    def noted(self: SacSteps, minibatches: Any, first: int, *rest: Any) -> Any:
        calls.append(first)
        return steps(self, minibatches, first, *rest)

    monkeypatch.setattr(SacSteps, "steps", noted)
    return calls


@pytest.mark.slow
def test_it_is_used_where_the_step_is_sac_s_own(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = counted(monkeypatch)
    found = built()
    update(found, batch(2))
    update(found, batch(2))
    assert calls == [1, 3]
    for other in (
        learner(SACConfig().training(precision="float32")),
        learner(SACConfig().training(precision="bfloat16", layer_norm=True)),
    ):
        update(other, batch(2))
    assert calls == [1, 3]


def test_a_subclass_with_a_step_of_its_own_keeps_it(monkeypatch: pytest.MonkeyPatch) -> None:
    calls, taken = counted(monkeypatch), []

    class Own(SACLearner):
        def _step(self, *arguments: Any) -> Any:
            taken.append(self._steps)
            return super()._step(*arguments)

    config = SACConfig().training(precision="bfloat16")
    monkeypatch.setattr(type(config), "get_default_learner_class", lambda self: Own)
    update(learner(config), batch(3))
    assert (calls, taken) == ([], [1, 2, 3])
