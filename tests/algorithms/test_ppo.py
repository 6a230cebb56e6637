"""PPO's rounds: what the environment receives, what is rated, what is counted."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import torch
from curricula import curriculum
from ray.rllib.core.columns import Columns
from ray.rllib.policy.sample_batch import DEFAULT_POLICY_ID

from envs.domains.load import load
from envs.types import MeshingParameters
from envs.vector_env import MeshVectorEnv
from freemesh_ray.algorithms.environment import register
from freemesh_ray.algorithms.ppo import PPO, PPOConfig
from freemesh_ray.local_ray import local_ray

pytestmark = pytest.mark.slow

#: Episodes that go nowhere end soon.
PARAMETERS = MeshingParameters(max_invalid=10)


@pytest.fixture(scope="module", autouse=True)
def ray() -> Iterator[None]:
    with local_ray(2):
        yield


def make(runners: int = 0, **training: Any) -> PPO:
    settings = {
        "hidden": [16, 16],
        "train_batch_size_per_learner": 160,
        "minibatch_size": 32,
        "num_epochs": 3,
        "curriculum": curriculum("T1", "T2", max_stage_steps=300),
    } | training
    return (
        PPOConfig()
        .environment(register(), env_config={"domain": [load("T1"), load("T2")], "parameters": PARAMETERS})
        .env_runners(num_env_runners=runners, num_envs_per_env_runner=4)
        .training(**settings)
        .debugging(seed=3, log_level="ERROR")
        .build_algo()
    )


def test_the_environment_receives_the_squashed_actions() -> None:
    """Replayed in a fresh environment with tanh of the actions that were kept: the same observations and rewards."""
    algorithm = make(curriculum=None)
    algorithm.env_runner.env.unwrapped.task.set({"T1": 1.0})
    begun = [episode for episode in algorithm.env_runner.rollout(400).episodes if episode.t_started == 0]
    longest = max(begun, key=len)
    env = MeshVectorEnv(num_envs=1, domain="T1", parameters=PARAMETERS)
    obs, _ = env.reset()
    assert len(longest) > 10
    for t, action in enumerate(longest.get_actions()):
        np.testing.assert_allclose(longest.get_observations(t), obs[0], atol=1e-4)
        obs, rewards, *_ = env.step(np.tanh(action)[None])
        assert longest.get_rewards(t) == pytest.approx(rewards[0], abs=1e-4)
    algorithm.stop()


def test_saturated_actions_are_rated_exactly() -> None:
    """Far out on the tanh, where no action tells its density any more, the learner's density is the runner's."""
    algorithm = make()
    runner, learner = algorithm.env_runner, algorithm.learner_group._learner
    for module in (runner.module, learner.module[DEFAULT_POLICY_ID]):
        with torch.no_grad():
            module.actor.biases[-1][:3] = torch.tensor([40.0, -40.0, 15.0])
    episodes = runner.rollout(100).episodes
    module = learner.module[DEFAULT_POLICY_ID]
    for episode in episodes:
        obs, u = (torch.from_numpy(np.asarray(x)) for x in (episode.get_observations()[:-1], episode.get_actions()))
        assert (u[:, :2].tanh().abs() == 1.0).all()
        outputs = module.forward_train({Columns.OBS: obs})[Columns.ACTION_DIST_INPUTS]
        rated = module.get_train_action_dist_cls().from_logits(outputs).logp(u).detach().numpy()
        np.testing.assert_allclose(rated, episode.get_extra_model_outputs(Columns.ACTION_LOGP), rtol=1e-4, atol=1e-4)
    for _ in range(3):
        algorithm.training_step()
    state = module.state_dict()
    assert all(torch.isfinite(value).all() for value in state.values())
    algorithm.stop()


def test_deterministic_sampling_takes_the_squashed_mean() -> None:
    algorithm = make()
    episode = algorithm.env_runner.sample(num_timesteps=20, explore=False)[0]
    seen = torch.from_numpy(np.asarray(episode.get_observations()[:-1]))
    with torch.no_grad():
        expected = algorithm.env_runner.module.actor(seen)[:, :3].numpy()
    np.testing.assert_allclose(episode.get_actions(), expected, rtol=1e-5, atol=1e-6)
    algorithm.stop()


@pytest.mark.parametrize("runners", [0, 2])
def test_rounds_are_counted_whole(runners: int) -> None:
    """Each round at least its steps and at most one more of each environment; every step updated ``epochs`` times."""
    algorithm = make(runners)
    for _ in range(4):
        steps, updates = algorithm.env_steps, algorithm.updates
        algorithm.training_step()
        assert 160 <= algorithm.env_steps - steps < 160 + 4 * max(1, runners)
        # RLlib appends a row, which is masked, to every piece of an episode.
        assert 3 * 160 // 32 <= algorithm.updates - updates <= 3 * 200 // 32 + 1
    assert algorithm.curriculum.stage == 1
    assert {episode.domain for episode in algorithm.finished} <= {"T1", "T2"}
    algorithm.stop()


def test_episodes_are_put_together_from_the_pieces_of_several_rounds() -> None:
    algorithm = make(curriculum=curriculum("T1"))
    pieces: dict[str, list[tuple[int, float]]] = {}
    ended = []
    for _ in range(30):
        harvest = algorithm.env_runner.rollout(40)
        for episode in harvest.episodes:
            pieces.setdefault(episode.id_, []).append((episode.t, sum(episode.get_rewards())))
        done = [episode.id_ for episode in harvest.episodes if episode.is_done]
        for key, one in zip(done, harvest.ended, strict=True):
            assert one.length == pieces[key][-1][0]
            assert one.episode_return == pytest.approx(sum(rewards for _, rewards in pieces[key]))
            ended.append(one)
    assert any(len(parts) > 1 for parts in pieces.values())
    assert ended
    assert not algorithm.env_runner._done_episodes_for_metrics, "episodes pile up"
    assert all(one.elements > 0 or one.length >= 10 for one in ended)
    algorithm.stop()


def test_large_errors_of_the_value_are_learnt_from() -> None:
    """RLlib's own bound on the value's loss leaves no gradient of an error of a thousand."""
    algorithm = make(lr=1e-2)
    value = algorithm.learner_group._learner.module[DEFAULT_POLICY_ID].value
    with torch.no_grad():
        value.biases[-1][:] = 1000.0
    algorithm.training_step()
    assert value.biases[-1].item() < 999.99
    algorithm.stop()


def test_advantages_are_the_generalised_estimates() -> None:
    """Schulman et al. (2016), equation 16: bootstrapped where a piece was cut, not where an episode terminated."""
    algorithm = make(gamma=0.9, lambda_=0.8)
    learner = algorithm.learner_group._learner
    module = learner.module[DEFAULT_POLICY_ID]
    episodes = [episode for _ in range(8) for episode in algorithm.env_runner.rollout(160).episodes]
    done = [episode for episode in episodes if episode.is_done]
    assert 1 < len(done) < len(episodes)
    done[0].is_terminated, done[0].is_truncated = True, False  # the others were truncated
    expected: list[float] = []
    for episode in episodes:
        with torch.no_grad():
            values = module.value(torch.from_numpy(np.asarray(episode.get_observations()))).numpy()[:, 0]
        if episode.is_terminated:
            values[-1] = 0.0
        errors = episode.get_rewards() + 0.9 * values[1:] - values[:-1]
        advantages = np.zeros(len(errors) + 1)
        for t in range(len(errors) - 1, -1, -1):
            advantages[t] = errors[t] + 0.9 * 0.8 * advantages[t + 1]
        expected += (advantages[:-1] + values[:-1]).tolist()
    rows = learner._learner_connector(rl_module=learner.module, batch={}, episodes=episodes, shared_data={})[
        DEFAULT_POLICY_ID
    ]
    kept = np.asarray(rows[Columns.LOSS_MASK], dtype=bool)
    np.testing.assert_allclose(np.asarray(rows["value_targets"])[kept], expected, rtol=1e-4, atol=1e-4)
    algorithm.stop()
