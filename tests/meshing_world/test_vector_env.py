"""The native vector environment: single environments, side by side."""

from __future__ import annotations

import pickle
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from envs.domains.endless import HELD_OUT
from envs.mesh_env import MeshEnv
from envs.vector_env import MeshVectorEnv

DOMAINS = ["random:11", "random:3", "T2"]


def random_actions(seed: int, steps: int, env: MeshVectorEnv) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (steps, *env.action_space.shape)).astype(np.float32)


def assert_same(a: Any, b: Any) -> None:
    """Equal through and through: arrays, meshes, numbers, and dictionaries of them."""
    if isinstance(a, dict):
        assert a.keys() == b.keys()
        for key in a:
            assert_same(a[key], b[key])
    elif hasattr(a, "quads"):
        assert_same(vars(a), vars(b))
    elif isinstance(a, tuple | list) or (isinstance(a, np.ndarray) and a.dtype.hasobject):
        for x, y in zip(a, b, strict=True):
            assert_same(x, y)
    else:
        np.testing.assert_array_equal(a, b)


def of_env(infos: dict[str, Any], i: int) -> dict[str, Any]:
    """What the infos of a batch tell of one environment."""
    return {key: value[i] for key, value in infos.items() if not key.startswith("_") and infos[f"_{key}"][i]}


class Single:
    """One environment that begins anew on the step after its end."""

    def __init__(self, **options: Any) -> None:
        self.env, self.ended = MeshEnv(DOMAINS, **options), False

    def step(self, action: np.ndarray) -> tuple[Any, ...]:
        if self.ended:
            self.ended = False
            observation, _ = self.env.reset()
            return observation, 0.0, False, False, {}
        result = self.env.step(action)
        self.ended = result[2] or result[3]
        return result


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"type2": True, "observation": "O3", "max_invalid": 20}])
def test_step_for_step_what_single_environments_give(options: dict) -> None:
    batch = gym.make_vec("FreeMesh-v0", num_envs=4, vectorization_mode="vector_entry_point", domain=DOMAINS, **options)
    assert isinstance(batch.unwrapped, MeshVectorEnv)
    assert batch.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
    singles = [Single(**options) for _ in range(4)]
    observations, infos = batch.reset(seed=10)
    for i, single in enumerate(singles):
        observation, info = single.env.reset(seed=10 + i)
        np.testing.assert_array_equal(observations[i], observation)
        assert infos["domain"][i] == info["domain"]
    endings = 0
    for actions in random_actions(0, 1200, batch.unwrapped):
        observations, rewards, terminated, truncated, infos = batch.step(actions)
        assert observations in batch.observation_space
        for i, single in enumerate(singles):
            observation, reward, over, cut, info = single.step(actions[i])
            np.testing.assert_array_equal(observations[i], observation)
            assert (rewards[i], terminated[i], truncated[i]) == (reward, over, cut)
            assert_same(of_env(infos, i), info)
            endings += over or cut
    assert endings > 10


def test_the_next_step_begins_anew_and_ignores_the_action() -> None:
    env = MeshVectorEnv(3, DOMAINS, max_elements=1)
    env.reset(seed=0)
    for actions in random_actions(1, 200, env):
        *_, terminated, truncated, infos = env.step(actions)
        if truncated.any():
            break
    assert not terminated.any()
    ended = truncated.copy()
    _, rewards, terminated, truncated, infos = env.step(actions)
    assert (rewards[ended] == 0.0).all()
    assert not (terminated | truncated)[ended].any()
    np.testing.assert_array_equal(infos["_eta_e"], ~ended)
    assert all(env.episodes.elements(int(i)) == env.episodes.steps(int(i)) == 0 for i in np.flatnonzero(ended))


def test_outcomes_do_not_change_afterwards() -> None:
    env = MeshVectorEnv(3, DOMAINS)
    kept, copies = [], []
    env.reset(seed=0)
    for actions in random_actions(2, 100, env):
        kept.append(env.step(actions))
        copies.append(pickle.loads(pickle.dumps(kept[-1])))
    assert_same(kept, copies)


@pytest.mark.parametrize("options", [{}, {"type2": True, "max_elements": 12}])
def test_a_saved_state_has_the_same_future(options: dict) -> None:
    env = MeshVectorEnv(4, DOMAINS, **options)
    env.task.set({"random-11": 1.0, "T2": 2.0})
    env.reset(seed=3)
    past, future = np.split(random_actions(3, 700, env), [333])
    for actions in past:
        env.step(actions)
    saved = pickle.dumps(env.get_state())
    expected = [env.step(actions) for actions in future]
    assert any((step[2] | step[3]).any() for step in expected)
    fresh = MeshVectorEnv(4, DOMAINS, **options)
    fresh.reset(seed=99)
    for again in (fresh, env):
        again.set_state(pickle.loads(saved))
        assert_same([again.step(actions) for actions in future], expected)
        assert again.task.get() == env.task.get()


def test_a_state_of_another_batch_is_refused() -> None:
    state = MeshVectorEnv(3, DOMAINS).get_state()
    for other in (MeshVectorEnv(2, DOMAINS), MeshVectorEnv(3, ["T3"]), MeshVectorEnv(3, DOMAINS, type2=True)):
        with pytest.raises(ValueError, match="other domains, parameters or batch size"):
            other.set_state(state)


def test_a_mask_resets_some() -> None:
    env = MeshVectorEnv(4, DOMAINS)
    env.reset(seed=0)
    for actions in random_actions(4, 20, env):
        before, *_ = env.step(actions)
    steps = [env.episodes.steps(i) for i in range(4)]
    mask = np.array([True, False, True, False])
    observations, infos = env.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(observations[~mask], before[~mask])
    assert [env.episodes.steps(i) for i in range(4)] == [0, steps[1], 0, steps[3]]
    np.testing.assert_array_equal(infos["_domain"], mask)


def test_seeds_one_by_one() -> None:
    env, other = MeshVectorEnv(3, DOMAINS), MeshVectorEnv(3, DOMAINS)
    assert_same(env.reset(seed=7), other.reset(seed=[7, 8, 9]))
    state = other.get_state()["randoms"]
    other.reset(seed=[None, 8, None])
    assert other.get_state()["randoms"][0] != state[0]
    assert_same(other.get_state()["randoms"][1], state[1])


def test_the_task_decides_what_is_drawn_next() -> None:
    env = MeshVectorEnv(8, DOMAINS)
    assert set(env.reset(seed=0)[1]["domain"]) > {"T2"}
    env.task.set({"T2": 1.0})
    assert env.task.get() == {"random-11": 0.0, "random-3": 0.0, "T2": 1.0}
    assert set(env.reset(seed=0)[1]["domain"]) == {"T2"}


def test_pictures() -> None:
    env = MeshVectorEnv(2, DOMAINS, render_mode="rgb_array")
    env.reset(seed=0)
    assert [picture.shape for picture in env.render()] == [(512, 512, 3)] * 2
    assert MeshVectorEnv(2, DOMAINS).render() is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"num_envs": 0}, "num_envs = 0: must be at least 1"),
        ({"render_mode": "human"}, "render_mode = 'human'"),
        ({"gama": 1.0}, "unknown environment option 'gama'"),
    ],
)
def test_bad_options_are_named(options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        MeshVectorEnv(**options)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_bad_action_names_its_environment(value: float) -> None:
    env = MeshVectorEnv(3, DOMAINS)
    env.reset(seed=0)
    actions = np.zeros((3, 3))
    actions[2, 1] = value
    with pytest.raises(ValueError, match="action 2 is not finite"):
        env.step(actions)
    with pytest.raises(ValueError, match="expected"):
        env.step(np.zeros(3))


def test_an_endless_supply_gives_a_new_domain_every_time() -> None:
    env = MeshVectorEnv(4, domain=["T1", "random"], max_invalid=4)
    env.reset(seed=3)
    names: list[str] = []
    tasks: list[str] = []
    for actions in np.random.default_rng(0).uniform(-1.0, 1.0, (200, 4, 3)):
        *_, infos = env.step(actions)
        if "domain" in infos:
            names += infos["domain"][infos["_domain"]].tolist()
            tasks += infos["task"][infos["_task"]].tolist()
    drawn = [name for name in names if name != "T1"]
    assert len(set(drawn)) == len(drawn) > 5
    assert {*tasks} == {"T1", "random"}
    assert all(int(name.removeprefix("random-")) < HELD_OUT for name in drawn)


@pytest.mark.slow
def test_episodes_on_drawn_domains_go_on_from_their_state() -> None:
    env, other = (MeshVectorEnv(4, domain=["T1", "random"], max_invalid=4) for _ in range(2))
    env.reset(seed=3)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (160, 4, 3))
    for action in actions[:80]:
        env.step(action)
    other.set_state(env.get_state())
    for action in actions[80:]:
        for mine, yours in zip(env.step(action)[:4], other.step(action)[:4], strict=True):
            np.testing.assert_array_equal(mine, yours)
    for i in range(4):
        np.testing.assert_array_equal(env.episodes.mesh(i).vertices, other.episodes.mesh(i).vertices)
