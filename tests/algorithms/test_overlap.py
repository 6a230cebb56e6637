"""Remote env runners that collect while the learner updates: what they act by is one round old, and nothing else."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ray import kill
from ray.rllib.policy.sample_batch import DEFAULT_POLICY_ID

from freemesh_ray import config
from freemesh_ray.algorithms.build import build
from freemesh_ray.algorithms.off_policy import OffPolicy
from freemesh_ray.local_ray import local_ray
from freemesh_ray.training import checkpoint

pytestmark = pytest.mark.slow

SETTINGS = [
    "runners.count=2", "runners.envs_per_runner=4", "learner.hidden=[16, 16]", "learner.batch_size=32",
    "learner.warmup_steps=100", "learner.updates_per_step=0.1", "curriculum.stages=[T1, T2]",
    "curriculum.max_stage_steps=300", "evaluation.episodes=2",
]  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def ray() -> Iterator[None]:
    with local_ray(4):
        yield


@pytest.fixture
def made() -> Iterator[Any]:
    """Makes algorithms, which end with the test."""
    algorithms: list[OffPolicy] = []

    def make(*sets: str) -> OffPolicy:
        algorithm = build(config.load(["train_smoke"], [*SETTINGS, *sets]))
        assert isinstance(algorithm, OffPolicy)
        algorithms.append(algorithm)
        return algorithm

    yield make
    for algorithm in algorithms:
        algorithm.stop()


def rounds(algorithm: OffPolicy, count: int, pause: float = 0.0) -> list[int]:
    """Take rounds; how old the weights were that each was collected with."""
    ages = []
    for _ in range(count):
        algorithm.training_step()
        time.sleep(pause)  # some find the answers there, some wait for them
        ages.append(int(algorithm.metrics.peek(("env_runners", "weights_age"))))
    return ages


def same(ours: OffPolicy, theirs: OffPolicy) -> None:
    assert (ours.env_steps, ours.updates, ours.finished) == (theirs.env_steps, theirs.updates, theirs.finished)
    assert ours.updates > 0
    first, second = (one.learner_group.get_state()["learner"]["rl_module"][DEFAULT_POLICY_ID] for one in (ours, theirs))
    for key in second:
        np.testing.assert_array_equal(first[key], second[key], err_msg=key)
    for mine, other in zip(ours.local_replay_buffer.sample(500), theirs.local_replay_buffer.sample(500), strict=True):
        np.testing.assert_array_equal(mine, other)


def test_it_is_the_same_training_however_long_each_takes(made: Any) -> None:
    quick, slow = made(), made()
    rounds(quick, 6)
    rounds(slow, 6, pause=0.05)
    same(quick, slow)


def test_weights_are_one_round_old_and_without_overlap_new(made: Any) -> None:
    """A round of 2 x 4 x 8 steps is owed 6.4 updates."""
    late, prompt = made(), made("runners.overlap=false")
    ages = rounds(late, 6)
    assert ages[:2] == [0, 0]  # the warm-up
    assert set(ages[3:]) <= {6, 7}
    assert set(rounds(prompt, 6)) == {0}
    assert not prompt._calls
    assert len(late._calls) == 2


def test_a_restored_training_goes_on_as_the_original(made: Any, tmp_path: Path) -> None:
    """With what was being collected when it was saved; one of another state gives that up."""
    original, other = made(), made("seed=99")
    rounds(original, 4)
    rounds(other, 3)
    checkpoint.write(original, {}, tmp_path / "checkpoint")
    checkpoint.hand_over(other, checkpoint.read(tmp_path / "checkpoint")[0], tmp_path / "checkpoint")
    rounds(original, 3)
    rounds(other, 3)
    same(original, other)


def test_one_that_dies_while_it_collects_is_replaced(made: Any) -> None:
    algorithm = made()
    rounds(algorithm, 3)
    runner = algorithm.env_runner_group._worker_manager.actors()[1]
    kill(runner, no_restart=False)
    before, deadline = algorithm.env_steps, time.monotonic() + 120
    while len(algorithm._calls) < 2 or not algorithm.incidents:
        algorithm.train()
        assert time.monotonic() < deadline
    assert "env runner 1 failed (its process died)" in algorithm.incidents[0]
    assert algorithm.env_steps > before
