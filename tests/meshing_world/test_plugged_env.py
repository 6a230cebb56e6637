"""A user's reward, observation, wrappers and domain source act in single and batched environments, and nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from plugged import Write, modules

from envs.domains.load import UserDomains, source
from envs.errors import PluginError
from envs.mdp.observation import bounds
from envs.mdp.user_defined import Step, View
from envs.mesh_env import MeshEnv
from envs.types import MeshingParameters
from envs.vector_env import MeshVectorEnv
from envs.wrappers.wrapped_env import WrappedVectorEnv, wrapped

STEPS = 300


@pytest.fixture
def write(tmp_path: Path) -> Iterator[Write]:
    with modules(tmp_path) as write:
        yield write


class Paper:
    """The paper's observation, by way of a plug-in."""

    def __init__(self, parameters: MeshingParameters) -> None:
        self.low, self.high = bounds(parameters)

    def __call__(self, view: View) -> np.ndarray:
        return view.observation


class Front(Paper):
    """Where the reference vertex is, and how much is left."""

    def __init__(self, parameters: MeshingParameters) -> None:
        self.low, self.high = np.full(3, -1e3), np.full(3, 1e3)

    def __call__(self, view: View) -> np.ndarray:
        return np.array([*view.front[0], view.area])


class Idle(gym.Wrapper):
    """Changes nothing."""


def walk(env: Any, count: int = 4, seed: int = 3) -> list[Any]:
    """What a batch of environments returns for random actions."""
    random = np.random.default_rng(seed)
    seen = [env.reset(seed=seed)[0]]
    for _ in range(STEPS):
        found = env.step(random.uniform(-1, 1, (count, 3)).astype(np.float32))
        seen += found[:4]
    return seen


def same(one: list[Any], other: list[Any]) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def test_the_paper_s_own_by_way_of_plug_ins_changes_no_bit() -> None:
    plain = walk(MeshVectorEnv(4, domain=["T1", "T2"]))
    paper = {"reward": lambda step: step.reward, "observe": Paper}
    assert same(plain, walk(MeshVectorEnv(4, domain=["T1", "T2"], **paper)))
    assert same(plain, walk(WrappedVectorEnv(4, [Idle], domain=["T1", "T2"])))
    assert same(plain, walk(WrappedVectorEnv(4, [Idle, Idle], domain=["T1", "T2"], **paper)))


def test_a_doubled_reward_doubles_rewards_and_returns() -> None:
    plain, doubled = MeshVectorEnv(4), MeshVectorEnv(4, reward=lambda step: 2 * step.reward)
    one, other = walk(plain), walk(doubled)
    for ours, theirs in zip(one[2::4], other[2::4], strict=True):
        np.testing.assert_array_equal(2 * ours, theirs)
    for i in range(4):
        assert doubled.episodes.episode_return(i) == pytest.approx(2 * plain.episodes.episode_return(i), rel=1e-12)


def test_a_step_tells_what_the_episode_has() -> None:
    steps: list[Step] = []
    env = MeshEnv("D9", reward=lambda step: steps.append(step) or 0.0)  # type: ignore[func-returns-value]
    env.reset(seed=1)
    random = np.random.default_rng(1)
    cut = 0
    for _ in range(STEPS):
        observation, _, terminated, truncated, info = env.step(random.uniform(-1, 1, 3))
        step = steps[-1]
        cut += len(step.elements)
        assert (step.rejection, step.eta_e, step.mu) == (info["rejection"], info["eta_e"], info["mu"])
        assert len(step.elements) == (0 if step.rejection else 1 + terminated)
        assert step.cut == cut == env.episodes.elements(0)
        assert step.area == pytest.approx(0 if terminated else float(observation[14]), abs=1e-6)
        assert (step.completed, step.truncated) == (terminated, truncated)
        if terminated or truncated:
            break
    mesh = env.episodes.mesh(0)
    np.testing.assert_array_equal(np.concatenate([step.elements for step in steps]), mesh.vertices[mesh.quads])


def test_an_observation_of_another_size_is_the_environment_s() -> None:
    env = MeshEnv("T1", observe=Front)
    check_env(env, skip_render_check=True)
    observation, _ = env.reset(seed=0)
    np.testing.assert_array_equal(observation, np.float32([*env.episodes.ring(0)[0], 1.0]))
    batch = MeshVectorEnv(2, observe=Front)
    walk(batch, 2)
    state, (obs, *_) = batch.get_state(), batch.step(np.zeros((2, 3)))
    other = MeshVectorEnv(2, observe=Front)
    other.reset(seed=9)
    other.set_state(state)
    np.testing.assert_array_equal(other.step(np.zeros((2, 3)))[0], obs)


@pytest.mark.parametrize(
    ("made", "words"),
    [
        ({"reward": lambda step: step.speed}, "env.reward: .*raised AttributeError: 'Step' object has no .* 'speed'"),
        ({"reward": lambda: 1.0}, "env.reward: .*raised TypeError"),
        ({"reward": lambda step: float("nan")}, "env.reward: .*returned nan: return a finite number"),
        ({"reward": lambda step: None}, "env.reward: .*returned None: return a number"),
        ({"reward": Paper}, "env.reward: .*is the class Paper: give a function"),
        ({"observe": len}, "env.observe: .*give a class of observations"),
        ({"observe": type("No", (), {"__init__": lambda self, p: None})}, "has no low and high: set both"),
        ({"observe": type("Low", (Paper,), {"high": property(lambda s: 0, lambda s, v: None)})}, "give .* low <= high"),
        ({"observe": type("Long", (Paper,), {"__call__": lambda s, v: np.zeros(7)})}, r"\(7,\): return \(15,\)"),
        ({"observe": type("Nan", (Paper,), {"__call__": lambda s, v: v.observation * np.nan})}, "returned nan"),
        ({"observe": type("Text", (Paper,), {"__call__": lambda s, v: "a"})}, "returned 'a': return 15 numbers"),
    ],
)  # fmt: skip
def test_a_plug_in_of_another_form_is_told(made: dict[str, Any], words: str) -> None:
    with pytest.raises(PluginError, match=words):
        walk(MeshVectorEnv(4, **made))


def stepping(function: Any) -> type:
    """A wrapper with another ``step``."""
    return type("Stepping", (gym.Wrapper,), {"step": lambda self, action: function(self.env.step(action))})


@pytest.mark.parametrize(
    ("wrapper", "words"),
    [
        (MeshEnv, "env.wrappers: .*is the class MeshEnv: give a class of gymnasium.Wrapper"),
        (stepping(lambda found: found[:4]), "return 5 values"),
        (stepping(lambda found: (found[0], np.nan, *found[2:])), "returned nan"),
        (stepping(lambda found: (found[0][:3], *found[1:])), r"observed \(3,\): return \(15,\)"),
        (stepping(lambda found: (np.full(15, np.inf), *found[1:])), "observed .*: return finite numbers"),
        (stepping(lambda found: found.nothing), "raised AttributeError"),
        (stepping(lambda found: (*found[:2], False, False, found[4])), "episode 0 is over"),
        (type("Two", (gym.Wrapper,), {"__init__": lambda self, env, more: None}), "raised TypeError"),
        (type("Discrete", (gym.Wrapper,), {"action_space": gym.spaces.Discrete(3)}), "actions are Discrete"),
        (type("Image", (gym.Wrapper,), {"observation_space": gym.spaces.Box(0, 1, (4, 4))}), "observations are Box"),
    ],
)
def test_a_wrapper_of_another_form_is_told(wrapper: type, words: str) -> None:
    with pytest.raises(PluginError, match=words):
        walk(WrappedVectorEnv(2, [wrapper], domain="D9"), 2)


def test_wrappers_of_gymnasium_s_own_act(write: Write) -> None:
    module = write(
        "import gymnasium as gym\n"
        "class Short(gym.wrappers.TimeLimit):\n    def __init__(self, env):\n        super().__init__(env, 5)\n"
    )
    env = wrapped([f"{module}:Short"], domain="T1")
    env.reset(seed=0)
    assert [env.step(np.zeros(3))[3] for _ in range(5)] == [False] * 4 + [True]
    batch = WrappedVectorEnv(2, [f"{module}:Short"], domain=["T1", "T2"])
    batch.task.set({"T2": 1.0})
    batch.reset(seed=0)
    infos = [batch.step(np.zeros((2, 3)))[4] for _ in range(5)][-1]
    assert infos["task"].tolist() == ["T2", "T2"]


def test_a_domain_source_gives_a_new_domain_every_episode_and_the_same_to_evaluate_on(write: Write) -> None:
    module = write(
        "import numpy as np\n"
        "def disc(random):\n    n = int(random.integers(7, 20))\n    turn = 2 * np.pi * np.arange(n) / n\n"
        "    return np.stack([np.cos(turn), np.sin(turn)], axis=1)\n"
    )
    supply = source(f"{module}:disc")
    assert isinstance(supply, UserDomains)
    assert supply.name == "disc"
    assert [len(d.ring) % 2 for d in supply.held_out(8)] == [0] * 8
    assert [d.name for d in supply.held_out(2)] == ["disc-held-out-0", "disc-held-out-1"]
    for ours, theirs in zip(supply.held_out(5), supply.held_out(5), strict=True):
        np.testing.assert_array_equal(ours.points, theirs.points)
    env = MeshEnv(f"{module}:disc")
    sizes = {len(env.reset(seed=seed) and env.episodes.ring(0)) for seed in range(20)}
    assert len(sizes) > 3
    assert walk(MeshVectorEnv(4, domain=["T1", f"{module}:disc"]))


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("return 3", "drew what cannot be meshed"),
        ("return [[0, 0], [2, 2], [2, 0], [0, 2]]", "drew what cannot be meshed"),
        ("return [[0, 0], [1, 0], [1, 1], [0, 1]]", "drew 4 vertices: draw 6 to 512"),
        ("return 1 / 0", "raised ZeroDivisionError: division by zero"),
    ],
)
def test_a_domain_source_that_draws_no_polygon_is_told(body: str, words: str, write: Write) -> None:
    module = write(f"def draw(random):\n    {body}\n")
    with pytest.raises(PluginError, match=f"curriculum.stages: {module}:draw: {words}"):
        MeshEnv(f"{module}:draw").reset(seed=0)
