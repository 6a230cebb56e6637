"""The algorithm inside RLlib: rounds, the traps of its checkpoints, fault tolerance."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from curricula import curriculum
from ray.rllib.core.columns import Columns
from ray.rllib.policy.sample_batch import DEFAULT_POLICY_ID

from envs.domains.load import load
from envs.types import MeshingParameters
from freemesh_ray import config
from freemesh_ray.algorithms.build import build
from freemesh_ray.algorithms.environment import register
from freemesh_ray.algorithms.sac import SAC, SACConfig
from freemesh_ray.local_ray import local_ray
from freemesh_ray.training.loop import checkpoint

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", autouse=True)
def ray() -> Iterator[None]:
    with local_ray(7):  # slots for two algorithms at a time
        yield


def make(runners: int = 0, seed: int = 3, **training: Any) -> SAC:
    settings = {
        "warmup_steps": 300,
        "updates_per_step": 0.1,
        "hidden": [16, 16],
        "train_batch_size_per_learner": 32,
        "replay_buffer_config": {"type": "EpisodeReplayBuffer", "capacity": 5000},
        "curriculum": curriculum("T1", "T2", promote_at=0.1, window=2),
    } | training
    return (
        SACConfig()
        .environment(register(), env_config={"domain": [load("T1"), load("T2")], "parameters": MeshingParameters()})
        .env_runners(num_env_runners=runners, num_envs_per_env_runner=4, rollout_fragment_length=10)
        .training(**settings)
        .debugging(seed=seed, log_level="ERROR")
        .build_algo()
    )


def weights(algorithm: SAC) -> dict[str, np.ndarray]:
    return algorithm.learner_group.get_state(components="learner/rl_module")["learner"]["rl_module"][DEFAULT_POLICY_ID]


def rounds(algorithm: SAC, count: int) -> None:
    for _ in range(count):
        algorithm.training_step()


@pytest.mark.parametrize("runners", [0, 2])
def test_a_restored_training_goes_on_as_the_original(runners: int, tmp_path: Path) -> None:
    """Bit for bit: weights, targets, temperature, optimizers, replay buffer, curriculum, episodes, random states."""
    original = make(runners)
    rounds(original, 30)
    assert original.updates > 0
    checkpoint.write(original, {}, tmp_path / "checkpoint")
    restored = make(runners, seed=99)
    checkpoint.hand_over(restored, checkpoint.read(tmp_path / "checkpoint")[0], tmp_path / "checkpoint")
    assert restored.env_steps == original.env_steps
    assert restored.updates == original.updates
    assert restored.curriculum == original.curriculum
    assert len(restored.local_replay_buffer) == len(original.local_replay_buffer) > 0
    rounds(original, 10)
    rounds(restored, 10)
    assert restored.finished == original.finished
    ours, theirs = weights(restored), weights(original)
    for name in theirs:
        np.testing.assert_array_equal(ours[name], theirs[name], err_msg=name)
    for algorithm in (original, restored):
        algorithm.stop()


def test_from_checkpoint_brings_everything_back(tmp_path: Path) -> None:
    """RLlib alone loses the temperature, the replay buffer and a curriculum kept in callbacks."""
    original = make()
    for _ in range(100):
        rounds(original, 5)
        if original.curriculum.stage == 1 and original.updates:
            break
    assert original.curriculum.stage == 1
    original.save_to_path(str(tmp_path / "checkpoint"))
    restored = SAC.from_checkpoint(str(tmp_path / "checkpoint"))
    assert restored.curriculum == original.curriculum
    assert restored.env_steps == original.env_steps
    assert weights(restored)["log_alpha"] == weights(original)["log_alpha"] != 0.0
    np.testing.assert_array_equal(
        restored.local_replay_buffer.get_state()["rows"][0], original.local_replay_buffer.get_state()["rows"][0]
    )
    for algorithm in (original, restored):
        algorithm.stop()


def test_a_checkpoint_of_other_stages_is_refused(tmp_path: Path) -> None:
    original = make()
    checkpoint.write(original, {}, tmp_path / "checkpoint")
    other = make(curriculum=curriculum("T2"))
    with pytest.raises(checkpoint.CheckpointError, match="T1 -> T2"):
        checkpoint.hand_over(other, checkpoint.read(tmp_path / "checkpoint")[0], tmp_path / "checkpoint")
    for algorithm in (original, other):
        algorithm.stop()


def test_rounds_warm_up_then_keep_the_ratio() -> None:
    algorithm = make(updates_per_step=0.25)
    while algorithm.env_steps < 300:
        assert algorithm.updates == 0
        rounds(algorithm, 1)
    rounds(algorithm, 10)
    assert algorithm.updates == int((algorithm.env_steps - 300) * 0.25)
    assert len(algorithm.local_replay_buffer) == algorithm.env_steps
    algorithm.stop()


def test_results_carry_the_metrics() -> None:
    algorithm = make()
    for _ in range(2):
        results = algorithm.train()
    assert results["env_runners"]["num_env_steps_sampled_lifetime"] == algorithm.env_steps
    assert results["env_runners"]["stage"] == algorithm.curriculum.stage
    assert {"episode_return_mean", "completion_rate", "element_quality_mean"} <= set(results["env_runners"])
    assert {"critic_loss", "actor_loss", "alpha"} <= set(results["learners"][DEFAULT_POLICY_ID])
    algorithm.stop()


def test_rllib_s_evaluate_runs_the_paper_s_episodes() -> None:
    algorithm = build(
        config.load(["train_smoke"], ["runners.count=0", "curriculum.stages=[T1, T2]", "evaluation.episodes=3"])
    )
    found = algorithm.evaluate()
    for kind in ("deterministic", "stochastic"):
        assert set(found[kind]) == {"T1", "T2"}
        assert all(0 <= figures["completion_rate"] <= 1 for figures in found[kind].values())
    again = algorithm.evaluate()
    assert again["stochastic"] == found["stochastic"]
    algorithm.stop()


def test_critics_are_exported_as_they_are() -> None:
    algorithm = make()
    module, critic = algorithm.learner_group._learner.module[DEFAULT_POLICY_ID].critic, algorithm.critic_weights()
    assert [weight.shape for weight, _ in critic] == [(2, 18, 16), (2, 16, 16), (2, 16, 1)]
    x = np.random.default_rng(0).standard_normal((5, 18)).astype(np.float32)
    expected = module(torch.from_numpy(x)).detach().numpy()
    for twin in range(2):
        y = x
        for i, (weight, bias) in enumerate(critic):
            y = y @ weight[twin] + bias[twin]
            y = np.maximum(y, 0.0) if i < 2 else y
        np.testing.assert_allclose(y, expected[twin], atol=1e-5)
    algorithm.stop()


def test_runners_get_the_learner_s_weights() -> None:
    algorithm = make(runners=1)
    rounds(algorithm, 20)
    assert algorithm.updates
    (acting,) = algorithm.env_runner_group.foreach_env_runner(
        lambda runner: runner.module.get_state(), local_env_runner=False
    )
    learnt = weights(algorithm)
    assert acting
    for name, value in acting.items():
        np.testing.assert_array_equal(value, learnt[name], err_msg=name)
    algorithm.stop()


def test_a_slow_runner_goes_on_with_the_restored_networks() -> None:
    """RLlib leaves new networks out while a runner has not answered an earlier message."""
    original = make()
    rounds(original, 20)
    restored = make(runners=1, seed=99)
    restored.env_runner_group.foreach_env_runner_async(lambda runner: time.sleep(1))
    restored.set_state(original.get_state())
    (acting,) = restored.env_runner_group.foreach_env_runner(
        lambda runner: runner.module.get_state(), local_env_runner=False
    )
    assert acting
    for name, value in acting.items():
        np.testing.assert_array_equal(value, weights(original)[name], err_msg=name)
    for algorithm in (original, restored):
        algorithm.stop()


def test_a_runner_that_dies_is_replaced_with_its_task() -> None:
    algorithm = make(runners=2)
    rounds(algorithm, 3)
    pids = algorithm.env_runner_group.foreach_env_runner(lambda runner: os.getpid(), local_env_runner=False)
    os.kill(pids[0], signal.SIGKILL)
    before = algorithm.env_steps
    for _ in range(40):
        algorithm.train()
        alive = algorithm.env_runner_group.foreach_env_runner(lambda runner: os.getpid(), local_env_runner=False)
        if len(alive) == 2:
            break
    assert len(alive) == 2
    assert pids[0] not in alive
    assert algorithm.env_steps > before
    tasks = algorithm.env_runner_group.foreach_env_runner(
        lambda runner: runner.env.unwrapped.task.get() if runner._obs is not None else None, local_env_runner=False
    )
    expected = {"T1": 0.0, "T2": 0.0} | algorithm.curriculum.task()
    assert all(task is None or task == pytest.approx(expected) for task in tasks)
    algorithm.stop()


def test_rllib_s_own_sampling_still_works_and_collect_recovers() -> None:
    algorithm = make()
    runner = algorithm.env_runner
    runner.collect(3)
    episodes = runner.sample(num_timesteps=20, random_actions=False, explore=False)
    assert sum(len(episode) for episode in episodes) >= 20
    assert all(np.abs(episode.get_actions()).max() <= 1.0 for episode in episodes)
    assert len(runner.collect(5).transitions) == 20
    algorithm.stop()


def test_collect_yields_the_environment_s_own_transitions() -> None:
    """Replayed in a fresh environment: same successors and rewards, ends kept apart, no reset among them."""
    algorithm = make(curriculum=None)
    runner = algorithm.env_runner
    runner.env.unwrapped.task.set({"T1": 1.0})
    parts = [runner.collect(1, uniform=True) for _ in range(400)]
    env = type(runner.env.unwrapped)(num_envs=1, domain="T1")
    ended = [episode for part in parts for episode in part.episodes]
    assert ended
    # With T1 alone all episodes start alike: follow the first environment from its first transition to its end.
    obs, _ = env.reset()
    total = 0.0
    for part in parts:
        row = part.transitions
        np.testing.assert_array_equal(row.obs[0], obs[0])
        obs, reward, terminated, truncated, _ = env.step(row.actions[:1])
        np.testing.assert_array_equal(row.next_obs[0], obs[0])
        assert row.rewards[0] == np.float32(reward[0])
        assert row.terminated[0] == terminated[0]
        total += reward[0]
        if terminated[0] or truncated[0]:
            assert any(abs(episode.episode_return - total) < 1e-9 for episode in ended)
            break
    else:
        pytest.fail("the first environment's episode did not end")
    algorithm.stop()


def test_the_module_s_connectors_and_deterministic_action() -> None:
    """``explore=False`` must give tanh(mean); RLlib's own SAC gives the mean."""
    import torch

    algorithm = make()
    module = algorithm.get_module()
    obs = torch.zeros(1, 15)
    out = module.forward_inference({Columns.OBS: obs})[Columns.ACTION_DIST_INPUTS]
    episodes = algorithm.env_runner.sample(num_timesteps=8, explore=False)
    first = episodes[0]
    seen = torch.from_numpy(first.get_observations(0)[None])
    expected = module.actor(seen)[0, :3].tanh().detach().numpy()
    np.testing.assert_allclose(first.get_actions(0), expected, rtol=1e-5, atol=1e-6)
    assert out.shape == (1, 6)
    algorithm.stop()
