"""Each algorithm learns a task that everybody's learn, in about as many steps as Stable-Baselines3's need."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pendulum
import pytest

from freemesh_ray.local_ray import local_ray

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", autouse=True)
def ray() -> Iterator[None]:
    with local_ray(0):
        yield


def test_doing_nothing_scores_badly() -> None:
    assert pendulum.score(lambda obs: np.zeros((len(obs), 1))) < -900


@pytest.mark.parametrize(("name", "steps"), [("td3", 12_000), ("ddpg", 12_000), ("ppo", 40_000)])
def test_it_learns_pendulum(name: str, steps: int) -> None:
    algorithm = pendulum.ours(name, seed=1)
    score, following = -np.inf, 3_000
    while score < -300 and algorithm.env_steps < steps:
        algorithm.training_step()
        if algorithm.env_steps >= following:
            score = pendulum.score(pendulum.deterministic(algorithm.actor_weights()))
            following += 1_000
    algorithm.stop()
    assert score >= -300, f"{score:.0f} after {algorithm.env_steps} steps"
    assert np.mean([episode.length for episode in algorithm.finished]) == 200
