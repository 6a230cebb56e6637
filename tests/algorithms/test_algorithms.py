"""What the training loop asks of every algorithm: rounds, a curriculum, policies to export, checkpoints that go on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from fixed_temperature import registered
from ray.rllib.policy.sample_batch import DEFAULT_POLICY_ID
from ray.tune.trainable import trainable

from freemesh_ray import config
from freemesh_ray.algorithms.build import build, config_class
from freemesh_ray.algorithms.mesh_algorithm import MeshAlgorithm, MeshConfig
from freemesh_ray.config import ALGORITHMS
from freemesh_ray.local_ray import local_ray
from freemesh_ray.policies.policy import Policy
from freemesh_ray.training import checkpoint

pytestmark = pytest.mark.slow

SETTINGS = [
    "runners.count=0", "runners.envs_per_runner=4", "learner.hidden=[16, 16]", "learner.batch_size=32",
    "learner.warmup_steps=100", "learner.updates_per_step=0.1", "ppo.rollout_steps=128", "ppo.epochs=2",
    "curriculum.stages=[T1, T2]", "curriculum.max_stage_steps=300", "evaluation.episodes=2",
]  # fmt: skip
#: Those that ship, and one with losses alone.
NAMES = [*ALGORITHMS, "fixed"]
ON_POLICY = ("ppo",)


@pytest.fixture(scope="module", autouse=True)
def ray() -> Iterator[None]:
    with registered(), local_ray(3):
        yield


def make(name: str, *sets: str) -> MeshAlgorithm:
    return build(config.load(["train_smoke"], [*SETTINGS, f"algorithm={name}", *sets]))


def rounds(algorithm: MeshAlgorithm, steps: int) -> None:
    until = algorithm.env_steps + steps
    while algorithm.env_steps < until:
        algorithm.training_step()


def learner_state(algorithm: MeshAlgorithm) -> dict[str, Any]:
    return algorithm.learner_group.get_state()["learner"]


def weights(algorithm: MeshAlgorithm) -> dict[str, np.ndarray]:
    return learner_state(algorithm)["rl_module"][DEFAULT_POLICY_ID]


@pytest.mark.parametrize("name", NAMES)
def test_every_entry_names_the_configuration_that_has_its_settings(name: str) -> None:
    found = config_class(name)()
    assert isinstance(found, MeshConfig)
    assert name in ON_POLICY or all(
        getattr(found, key) == setting.default for key, setting in ALGORITHMS[name].settings.items()
    )


@pytest.mark.parametrize("name", NAMES)
def test_rounds_train_and_count(name: str) -> None:
    algorithm = make(name)
    before = weights(algorithm)
    while not algorithm.updates or algorithm.curriculum.stage == 0:
        results = algorithm.train()
    assert algorithm.env_steps > 300
    assert results["env_runners"]["num_env_steps_sampled_lifetime"] == algorithm.env_steps
    assert {"critic_loss", "actor_loss"} <= set(results["learners"][DEFAULT_POLICY_ID]) or name in ON_POLICY
    assert any(not np.array_equal(before[key], value) for key, value in weights(algorithm).items())
    assert all(np.isfinite(value).all() for value in weights(algorithm).values())
    assert sum(episode.length for episode in algorithm.finished) <= algorithm.env_steps
    assert {episode.domain for episode in algorithm.finished} <= {"T1", "T2"}
    acting = algorithm.env_runner.module.get_state()
    for key, value in acting.items():
        np.testing.assert_array_equal(value, weights(algorithm)[key], err_msg=key)
    algorithm.stop()


def test_nothing_is_left_in_the_user_s_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trainable, "DEFAULT_STORAGE_PATH", str(tmp_path / "ray_results"))
    algorithm = make("sac")
    rounds(algorithm, 100)
    algorithm.stop()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        *((name, ()) for name in NAMES),
        ("sac", ("learner.normalise_observations=true",)),
        ("sac", ("learner.layer_norm=true",)),
    ],
)
def test_what_is_exported_acts_as_the_module_does(name: str, settings: tuple[str, ...]) -> None:
    algorithm = make(name, *settings)
    rounds(algorithm, 300)
    module = algorithm.learner_group._learner.module[DEFAULT_POLICY_ID]
    parameters = config.meshing_parameters(config.load(["train_smoke"], SETTINGS))
    policy = Policy(algorithm.actor_weights(), parameters, {}, algorithm.critic_weights())
    obs = np.random.default_rng(0).standard_normal((50, 15)).astype(np.float32)
    with torch.no_grad():
        seen = module.seen(torch.from_numpy(obs)) if settings else torch.from_numpy(obs)
        expected = module.actor(seen)[:, :3].tanh().numpy()
    np.testing.assert_allclose(policy.act(obs, False, np.random.default_rng(0)), expected, atol=1e-5)
    plain = [] if "learner.layer_norm=true" in settings else [2]
    assert [weight.shape[0] for weight, _ in policy.critic[:1]] == {"ddpg": [1], "ppo": []}.get(name, plain)
    found = algorithm.evaluate()
    assert set(found) == {"deterministic", "stochastic"}
    assert all(np.isfinite(list(figures.values())).all() for kind in found.values() for figures in kind.values())
    algorithm.stop()


@pytest.mark.parametrize("name", ["td3", "ddpg"])
def test_the_export_explores_as_the_training_does_in_the_middle(name: str) -> None:
    algorithm = make(name, f"{name}.exploration_noise=0.05")
    *hidden, (weight, bias) = algorithm.actor_weights()
    policy = Policy(
        [*hidden, (weight * 0, np.where(np.arange(6) < 3, 0, bias))],
        config.meshing_parameters(config.load()),
    )
    drawn = policy.act(np.zeros((20_000, 15), dtype=np.float32), True, np.random.default_rng(0))
    assert drawn.std() == pytest.approx(0.05, rel=0.03)
    algorithm.stop()


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        *((name, ()) for name in NAMES if name not in ON_POLICY),
        *((name, ("learner.precision=bfloat16",)) for name in NAMES if name not in ON_POLICY),
        ("sac", ("learner.n_step=3", "learner.precision=bfloat16", "sac.policy_delay=2")),
        ("td3", ("learner.normalise_observations=true", "learner.n_step=2", "learner.layer_norm=true")),
    ],
)
def test_a_restored_training_goes_on_as_the_original(name: str, settings: tuple[str, ...], tmp_path: Path) -> None:
    """Bit for bit: networks, optimizers, experience, curriculum, episodes in flight, random states."""
    original = make(name, *settings)
    rounds(original, 450)
    checkpoint.write(original, {}, tmp_path / "checkpoint")
    restored = make(name, "seed=99", *settings)
    checkpoint.hand_over(restored, checkpoint.read(tmp_path / "checkpoint")[0], tmp_path / "checkpoint")
    for algorithm in (original, restored):
        rounds(algorithm, 300)
    assert restored.updates == original.updates > 0
    assert restored.curriculum == original.curriculum
    assert restored.finished == original.finished
    ours, theirs = weights(restored), weights(original)
    for key in theirs:
        np.testing.assert_array_equal(ours[key], theirs[key], err_msg=key)
    for algorithm in (original, restored):
        algorithm.stop()


@pytest.mark.parametrize("name", NAMES)
def test_a_restored_training_learns_at_the_rate_of_its_configuration(name: str, tmp_path: Path) -> None:
    original = make(name)
    rounds(original, 300)
    checkpoint.write(original, {}, tmp_path / "checkpoint")
    restored = make(name, "learner.learning_rate=1e-9")
    checkpoint.hand_over(restored, checkpoint.read(tmp_path / "checkpoint")[0], tmp_path / "checkpoint")
    for key, value in weights(original).items():
        np.testing.assert_array_equal(weights(restored)[key], value, err_msg=key)
    assert (restored.env_steps, restored.updates) == (original.env_steps, original.updates)
    assert restored.curriculum == original.curriculum
    for algorithm in (original, restored):
        rounds(algorithm, 150)
        assert algorithm.updates > 0
    drift = {key: np.abs(weights(restored)[key] - value).max() for key, value in weights(original).items()}
    checkpoint.hand_over(original, checkpoint.read(tmp_path / "checkpoint")[0], tmp_path / "checkpoint")
    for key, value in weights(original).items():
        # Targets and running figures follow at rates of their own.
        if not key.startswith("target") and not key.endswith((".mean", ".variance", ".batches")):
            np.testing.assert_allclose(weights(restored)[key], value, rtol=0, atol=1e-6, err_msg=key)
    assert max(drift.values()) > 1e-5
    for algorithm in (original, restored):
        algorithm.stop()
