"""Learners in processes of their own: together they do what one does, and stay alike."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import learners
import numpy as np
import pytest
from learners import batch, learner, module, update
from ray import cloudpickle
from ray.rllib.policy.sample_batch import DEFAULT_POLICY_ID

from freemesh_ray import config
from freemesh_ray.algorithms.build import build
from freemesh_ray.algorithms.ddpg import DDPGConfig
from freemesh_ray.algorithms.mesh_algorithm import MeshAlgorithm
from freemesh_ray.algorithms.off_policy import OffPolicyConfig, learner_shares
from freemesh_ray.algorithms.replay_buffer import Transitions
from freemesh_ray.algorithms.sac import SACConfig
from freemesh_ray.algorithms.td3 import TD3Config
from freemesh_ray.local_ray import local_ray
from freemesh_ray.training import checkpoint

pytestmark = pytest.mark.slow

LEARNERS, MINIBATCHES = 2, 5
SETTINGS = [
    "runners.count=0", "runners.envs_per_runner=4", "learner.hidden=[16, 16]", "learner.batch_size=32",
    "learner.warmup_steps=100", "learner.updates_per_step=0.1", "ppo.rollout_steps=128", "ppo.epochs=2",
]  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def ray() -> Iterator[None]:
    cloudpickle.register_pickle_by_value(learners)  # the processes do not find the tests' modules
    with local_ray(2 * LEARNERS):
        yield
    cloudpickle.unregister_pickle_by_value(learners)


def make(name: str, learners: int, seed: int = 0) -> MeshAlgorithm:
    sets = [f"algorithm={name}", f"learner.count={learners}", f"seed={seed}"]
    return build(config.load(["train_smoke"], [*SETTINGS, *sets]))


@pytest.fixture(scope="module")
def joined() -> Iterator[MeshAlgorithm]:
    algorithm = make("sac", LEARNERS)
    yield algorithm
    algorithm.stop()


def each(algorithm: MeshAlgorithm, function: Callable[[Any], Any]) -> list[Any]:
    """What ``function`` says of every learner, in its process."""
    return [result.get() for result in algorithm.learner_group.foreach_learner(function)]


def in_step(algorithm: MeshAlgorithm) -> bool:
    """Whether all learners have the same weights, bit for bit."""
    first, *others = each(algorithm, lambda one: one.get_state()["rl_module"][DEFAULT_POLICY_ID])
    assert len(others) == LEARNERS - 1
    return all(np.array_equal(first[key], other[key]) for other in others for key in first)


def trained(algorithm: MeshAlgorithm, updates: int) -> MeshAlgorithm:
    until = algorithm.updates + updates
    while algorithm.updates < until:
        algorithm.training_step()
    return algorithm


def shares(rows: dict[str, np.ndarray]) -> list[dict[str, np.ndarray]]:
    """What each learner gets of ``MINIBATCHES`` minibatches."""
    each_share = learner_shares(Transitions(*rows.values()), MINIBATCHES, LEARNERS)
    return [dict(zip(rows, part, strict=True)) for part in each_share]


def test_every_learner_has_its_share_of_every_minibatch() -> None:
    rows = batch(MINIBATCHES)
    for key, column in rows.items():
        parts = [share[key].reshape(MINIBATCHES, -1, *column.shape[1:]) for share in shares(rows)]
        assert [len(part[0]) for part in parts] == [len(column) // MINIBATCHES // LEARNERS] * LEARNERS
        np.testing.assert_array_equal(np.concatenate(parts, axis=1).reshape(column.shape), column)


@pytest.mark.parametrize("make_config", [SACConfig, TD3Config, DDPGConfig])
def test_two_learners_do_what_one_does_with_the_rows_of_both(
    joined: MeshAlgorithm, make_config: type[OffPolicyConfig]
) -> None:
    """In the two processes that RLlib has joined; they begin with other weights, of which the first's count."""
    rows = batch(MINIBATCHES)
    parts = shares(rows)

    def together(host: Any) -> dict[str, np.ndarray]:
        settings = make_config().learners(num_learners=LEARNERS)
        one = learner(settings, seed=host._learner_index, noise=0, index=host._learner_index)
        update(one, parts[host._learner_index])
        return {name: tensor.numpy() for name, tensor in module(one).state_dict().items()}

    first, second = each(joined, together)
    alone = learner(make_config())
    before = {name: tensor.clone().numpy() for name, tensor in module(alone).state_dict().items()}
    update(alone, rows)
    for name, tensor in module(alone).state_dict().items():
        np.testing.assert_array_equal(first[name], second[name], err_msg=name)
        np.testing.assert_allclose(first[name], tensor.numpy(), rtol=1e-5, atol=1e-6, err_msg=name)
        assert not np.array_equal(first[name], before[name]), name


def test_learners_stay_in_step_and_a_checkpoint_goes_on_with_any_number_of_them(
    joined: MeshAlgorithm, tmp_path: Path
) -> None:
    """Begun by two: gone on with by the same two and by one, to the same weights up to rounding."""
    trained(joined, 20).save_to_path(str(tmp_path / "checkpoint"))
    assert in_step(joined)
    alone = make("sac", 0, seed=9)
    weights = []
    for algorithm in (joined, alone):
        algorithm.restore_from_path(str(tmp_path / "checkpoint"))
        trained(algorithm, 20)
        weights.append(algorithm.learner_group.get_state()["learner"]["rl_module"][DEFAULT_POLICY_ID])
    assert in_step(joined)
    assert alone.updates == joined.updates >= 40
    for name, values in weights[0].items():
        np.testing.assert_allclose(weights[1][name], values, rtol=1e-3, atol=1e-5, err_msg=name)
    alone.stop()


def test_restored_learners_go_on_as_the_original(joined: MeshAlgorithm, tmp_path: Path) -> None:
    """Bit for bit, and in step."""
    trained(joined, 20)
    checkpoint.write(joined, {}, tmp_path / "checkpoint")
    restored = make("sac", LEARNERS, seed=9)
    checkpoint.hand_over(restored, checkpoint.read(tmp_path / "checkpoint")[0], tmp_path / "checkpoint")
    theirs, ours = (trained(algorithm, 20).learner_group.get_state() for algorithm in (joined, restored))
    assert in_step(restored)
    for name, values in theirs["learner"]["rl_module"][DEFAULT_POLICY_ID].items():
        np.testing.assert_array_equal(ours["learner"]["rl_module"][DEFAULT_POLICY_ID][name], values, err_msg=name)
    restored.stop()


def test_the_runners_act_with_what_the_learners_have_learnt(joined: MeshAlgorithm) -> None:
    trained(joined, 1)
    learnt = joined.learner_group.get_state()["learner"]["rl_module"][DEFAULT_POLICY_ID]
    for key, value in joined.env_runner.module.get_state().items():
        np.testing.assert_array_equal(value, learnt[key], err_msg=key)


def test_ppo_s_learners_stay_in_step(tmp_path: Path) -> None:
    """Restored ones, too."""
    algorithm = make("ppo", LEARNERS)
    before = algorithm.actor_weights()
    trained(algorithm, 1)
    assert algorithm.updates == 2 * (algorithm.env_steps // 64)
    assert in_step(algorithm)
    assert not np.array_equal(algorithm.actor_weights()[0][0], before[0][0])
    checkpoint.write(algorithm, {}, tmp_path / "checkpoint")
    algorithm.stop()
    restored = make("ppo", LEARNERS, seed=9)
    checkpoint.hand_over(restored, checkpoint.read(tmp_path / "checkpoint")[0], tmp_path / "checkpoint")
    trained(restored, 1)
    assert in_step(restored)
    restored.stop()
