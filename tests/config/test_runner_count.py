"""``runners.count: auto``: a core for the learner, and the runners that it can take experience from."""

from __future__ import annotations

import os
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from freemesh_ray import config
from freemesh_ray.config.env_runner_count import runner_count


def tree(**settings: Any) -> dict[str, Any]:
    return config.load([], [f"{key.replace('__', '.')}={value}" for key, value in settings.items()])


@pytest.mark.slow
@given(
    cores=st.integers(1, 64), learners=st.sampled_from([0, 1, 2, 4]), updates=st.floats(1e-4, 4.0),
    fragment=st.integers(1, 256), algorithm=st.sampled_from(["sac", "td3", "ppo"]),
)  # fmt: skip
def test_auto_never_takes_more_than_the_cores(
    cores: int, learners: int, updates: float, fragment: int, algorithm: str
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "sched_getaffinity", lambda _: set(range(cores)))
        count, fewer, longer = (
            runner_count(
                tree(
                    learner__count=learners,
                    learner__updates_per_step=often,
                    runners__fragment=steps,
                    algorithm=algorithm,
                )
            )
            for often, steps in ((updates, fragment), (min(4.0, 2 * updates), fragment), (updates, 1000))
        )
    assert 0 <= fewer <= count <= longer <= (cores if algorithm == "ppo" else cores - 1)
    assert longer >= 1 or cores <= max(1, learners)


def test_a_round_that_is_sooner_taken_than_sent_is_taken_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the defaults it takes about a millisecond, and its messages two and a half."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)))
    assert runner_count(tree()) == 0
    assert runner_count(tree(runners__fragment=64)) == 1
    assert runner_count(tree(runners__fragment=64, learner__updates_per_step=1 / 256)) == 3
    assert runner_count(tree(runners__envs_per_runner=128)) == 1


def test_a_number_is_taken_as_it_stands() -> None:
    assert runner_count(tree(runners__count=7)) == 7
    assert runner_count(tree(runners__count=0)) == 0
