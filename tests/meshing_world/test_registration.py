"""``envs:FreeMesh-v0``: an environment for whoever only names it, alone and in batches of every sort."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from checkout import ROOT
from gymnasium.wrappers import RescaleAction, vector
from processes import outside

from envs.vector_env import MeshVectorEnv

NAME = "envs:FreeMesh-v0"


def fresh(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """What an interpreter says that has imported nothing and stands elsewhere."""
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder, env=outside() | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=300,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    "code",
    [
        f"import gymnasium as gym; env = gym.make({NAME!r}, domain='T2'); print(env.reset(seed=1)[0].shape)",
        f"import gymnasium as gym; env = gym.make_vec({NAME!r}, num_envs=1); print(env.reset(seed=1)[0].shape[1:])",
        "from stable_baselines3.common.env_util import make_vec_env\n"
        f"env = make_vec_env({NAME!r}, n_envs=2, env_kwargs={{'domain': 'T2'}}); print(env.reset().shape[1:])",
    ],
    ids=["make", "make_vec", "stable_baselines3"],
)
def test_the_name_is_enough(code: str, tmp_path: Path) -> None:
    """RLlib's `.environment` takes it, too: tests/docs/test_baselines.py."""
    if "stable_baselines3" in code:
        pytest.importorskip("stable_baselines3")
    done = fresh(code, tmp_path)
    assert (done.returncode, done.stdout) == (0, "(15,)\n"), done.stderr


def test_gymnasium_reads_no_entry_points(tmp_path: Path) -> None:
    """Where it begins to, pyproject.toml can register the environment, and the name needs no `envs:`."""
    done = fresh(
        "import gymnasium as gym\ntry: gym.make('FreeMesh-v0')\nexcept gym.error.UnregisteredEnv: print('unknown')\n"
        "from gymnasium.envs import registration; print(hasattr(registration, 'load_plugin_envs'))",
        tmp_path,
    )
    assert done.stdout == "unknown\nFalse\n", done.stderr


def transitions(envs: gym.vector.VectorEnv, steps: int = 60) -> list[np.ndarray]:
    """Observations, rewards and flags of the same random actions; ends in a minute also where a process hangs."""
    random, taken = np.random.default_rng(7), []
    envs.reset(seed=3)
    for _ in range(steps):
        taken += envs.step(random.uniform(-1, 1, (4, 3)).astype(np.float32))[:4]
    envs.close()
    return taken


@pytest.mark.parametrize("mode", [None, "vector_entry_point", "sync", "async"])
def test_every_way_of_batching_is_the_same(mode: str | None) -> None:
    """Episodes that end and begin anew among them."""
    options = {"domain": ["T1", "T2"], "max_invalid": 3}
    envs = gym.make_vec(NAME, num_envs=4, vectorization_mode=mode, **options)
    assert isinstance(envs, MeshVectorEnv) == (mode in (None, "vector_entry_point"))
    expected = transitions(gym.make_vec(NAME, num_envs=4, vectorization_mode="sync", **options))
    for ours, theirs in zip(transitions(envs), expected, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert sum(flags.sum() for flags in expected[3::4]) > 4


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_wrappers_of_single_environments(mode: str) -> None:
    """Actions in half the range: as twice the actions without the wrapper."""

    def halved(env: gym.Env) -> gym.Env:
        return RescaleAction(env, np.float32(-0.5), np.float32(0.5))

    envs = gym.make_vec(NAME, num_envs=4, vectorization_mode=mode, wrappers=[halved])
    plain = gym.make_vec(NAME, num_envs=4, vectorization_mode="sync")
    assert envs.single_action_space.high.max() == 0.5
    actions = np.random.default_rng(0).uniform(-0.5, 0.5, (4, 3)).astype(np.float32)
    envs.reset(seed=1), plain.reset(seed=1)
    for ours, theirs in zip(envs.step(actions)[:2], plain.step(2 * actions)[:2], strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-6)
    envs.close()


def test_the_batched_environment_takes_wrappers_of_batches() -> None:
    """Gymnasium has no place for single environments' where there are none."""
    with pytest.raises(gym.error.Error, match=r"vector_entry_point.* wrappers"):
        gym.make_vec(NAME, num_envs=4, wrappers=[lambda env: env])
    envs = vector.RescaleAction(gym.make_vec(NAME, num_envs=4), np.float32(-0.5), np.float32(0.5))
    plain = gym.make_vec(NAME, num_envs=4)
    actions = np.random.default_rng(0).uniform(-0.5, 0.5, (4, 3)).astype(np.float32)
    envs.reset(seed=1), plain.reset(seed=1)
    np.testing.assert_allclose(envs.step(actions)[0], plain.step(2 * actions)[0], atol=1e-6)
