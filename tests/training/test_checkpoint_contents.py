"""What trainings really put into checkpoints: plain values and arrays, from which all goes on bit for bit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from envs.types import DENSITIES, NAMED
from envs.vector_env import MeshVectorEnv
from freemesh_ray import config
from freemesh_ray.algorithms.build import build
from freemesh_ray.algorithms.mesh_algorithm import MeshAlgorithm
from freemesh_ray.config import ALGORITHMS
from freemesh_ray.local_ray import local_ray
from freemesh_ray.storage import state_file
from freemesh_ray.training import checkpoint

pytestmark = pytest.mark.slow

#: Episodes are short, so that many domains are drawn; the actor's steps are rarer than rounds.
SETTINGS = [
    "runners.count=0", "runners.envs_per_runner=3", "learner.hidden=[8, 8]", "learner.batch_size=16",
    "learner.buffer_size=300", "learner.warmup_steps=60", "learner.updates_per_step=0.1", "td3.policy_delay=7",
    "ppo.rollout_steps=64", "ppo.minibatch_size=32", "ppo.epochs=1", "curriculum.stages=[T1, random]",
    "curriculum.max_stage_steps=50", "env.max_invalid=4",
]  # fmt: skip

options = st.fixed_dictionaries(
    {
        "observation": st.sampled_from(list(NAMED["observation"])),
        "radius": st.sampled_from(list(NAMED["radius"])),
        "density": st.sampled_from(DENSITIES),
        "extended": st.booleans(),
        "irregular": st.sampled_from([0.0, 0.5]),
        "type2": st.booleans(),
        "max_invalid": st.integers(1, 8),
    }
)
domains = st.lists(st.sampled_from(["T1", "T2", "random:5", "random"]), min_size=1, max_size=3, unique=True)


def same(one: Any, other: Any) -> bool:
    """Equal bit for bit as checkpoints keep it: mappings are dicts, named tuples tuples, NumPy's scalars numbers."""
    if isinstance(one, Mapping):
        alike = isinstance(other, Mapping) and list(one) == list(other)
        return alike and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        alike = isinstance(other, list if isinstance(one, list) else tuple) and len(one) == len(other)
        return alike and all(map(same, one, other))
    if isinstance(one, np.ndarray):
        alike = isinstance(other, np.ndarray) and one.dtype == other.dtype and one.shape == other.shape
        return alike and one.tobytes() == other.tobytes()
    one, other = (node.item() if isinstance(node, np.generic) else node for node in (one, other))
    return type(one) is type(other) and (one == other or one != one != other)


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(domains, options, st.integers(1, 4), st.integers(0, 40), st.integers(0, 2**31 - 1))
def test_environments_go_on_from_what_a_file_keeps_of_them(
    tmp_path: Path, domains: list[str], options: dict[str, Any], num_envs: int, steps: int, seed: int
) -> None:
    env, other = (MeshVectorEnv(num_envs, domains, **options) for _ in range(2))
    actions = np.random.default_rng(seed).uniform(-1.0, 1.0, (steps + 30, *env.action_space.shape))
    env.task.set({name: float(i + 1) for i, name in enumerate(env.task.names)})
    env.reset(seed=seed)
    other.reset(seed=seed + 1)
    for action in actions[:steps]:
        env.step(action)
    state_file.save(env.get_state(), tmp_path / "state")
    kept = state_file.load(tmp_path / "state")
    assert same(env.get_state(), kept)
    other.set_state(kept)
    for action in actions[steps:]:
        assert all(map(same, env.step(action)[:4], other.step(action)[:4]))
    assert same(env.get_state(), other.get_state())
    for i in range(num_envs):
        assert same(vars(env.episodes.mesh(i)), vars(other.episodes.mesh(i)))


class Pair:
    """Two trainings of one configuration with different seeds; the first begins anew as often as it is asked to."""

    def __init__(self, name: str, folder: Path) -> None:
        trees = (config.load(["train_smoke"], [*SETTINGS, f"algorithm={name}", f"seed={seed}"]) for seed in (1, 2))
        # In a thread of its own: RLlib looks through the whole stack for each part, and a test's is long.
        with ThreadPoolExecutor(1) as thread:
            self.original, self.restored = thread.map(build, trees)
        self.folder = folder
        self.beginning = folder / "beginning"
        checkpoint.write(self.original, {}, self.beginning)

    def begin(self) -> None:
        """Go back to before the first step."""
        checkpoint.hand_over(self.original, checkpoint.read(self.beginning)[0], self.beginning)

    def stop(self) -> None:
        """End both."""
        for algorithm in (self.original, self.restored):
            algorithm.stop()


@pytest.fixture(scope="module")
def ray() -> Iterator[None]:
    with local_ray(1):
        yield


@pytest.fixture(params=ALGORITHMS)
def pair(request: pytest.FixtureRequest, ray: None, tmp_path: Path) -> Iterator[Pair]:
    both = Pair(request.param, tmp_path)
    yield both
    both.stop()


def rounds(algorithm: MeshAlgorithm, steps: int) -> None:
    until = algorithm.env_steps + steps
    while algorithm.env_steps < until:
        algorithm.training_step()


def lasting(algorithm: MeshAlgorithm) -> dict[str, Any]:
    """All that an algorithm is, but for RLlib's statistics, and the networks that its environments are played with."""
    acting = algorithm.env_runner.module.get_state()
    state = {key: value for key, value in algorithm.get_state().items() if key not in ("metrics_logger", "env_runner")}
    return state | {"acting": acting}


@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(steps=st.integers(0, 500), more=st.integers(1, 120))
def test_trainings_go_on_from_what_a_checkpoint_keeps_of_them(pair: Pair, steps: int, more: int) -> None:
    original, restored, path = pair.original, pair.restored, pair.folder / "checkpoint"
    pair.begin()
    rounds(original, steps)
    checkpoint.write(original, {}, path)
    kept, _ = checkpoint.read(path)
    assert same(original.get_state(), kept)
    checkpoint.hand_over(restored, kept, path)
    assert same(lasting(original), lasting(restored))
    for algorithm in (original, restored):
        rounds(algorithm, more)
    if "rollouts" in kept:  # PPO keeps no episodes: it begins new ones, and its actions are of this process's stream
        assert same(lasting(original), lasting(restored))
    else:
        assert min(original.env_steps, restored.env_steps) >= kept["env_steps"] + more
