"""``runners.count: auto``: a core for the learner, and the runners that it can take experience from."""

from __future__ import annotations

import os
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from freemesh_ray import config
from freemesh_ray.config.runners import runner_count


def tree(**settings: Any) -> dict[str, Any]:
    return config.load([], [f"{key.replace('__', '.')}={value}" for key, value in settings.items()])


@given(
    cores=st.integers(1, 64), learners=st.integers(0, 4), updates=st.floats(1e-4, 4.0),
    algorithm=st.sampled_from(["sac", "td3", "ppo"]),
)  # fmt: skip
def test_auto_never_takes_more_than_the_cores(cores: int, learners: int, updates: float, algorithm: str) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "sched_getaffinity", lambda _: set(range(cores)))
        count, fewer = (
            runner_count(tree(learner__count=learners, learner__updates_per_step=often, algorithm=algorithm))
            for often in (updates, min(4.0, 2 * updates))
        )
    assert 0 <= fewer <= count <= (cores if algorithm == "ppo" else cores - 1)
    assert count >= 1 or cores <= max(1, learners)
    if cores == 1:
        assert count == 0


def test_a_number_is_taken_as_it_stands() -> None:
    assert runner_count(tree(runners__count=7)) == 7
    assert runner_count(tree(runners__count=0)) == 0
