"""``FreeMesh-v0`` as a Gymnasium environment."""

from __future__ import annotations

import sys
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from fake_pygame import FakePygame
from gymnasium.utils.env_checker import check_env
from play import generic

from envs.domains.load import load
from envs.mdp.action import ACTION_TYPES, REJECTIONS
from envs.mdp.front import element_cap
from envs.mdp.transition import numbers
from envs.mesh import Mesh
from envs.mesh_env import MeshEnv, Task
from envs.types import DENSITIES, Domain, DomainError, MeshingParameters
from envs.vector_env import MeshVectorEnv

STEP_KEYS = {"eta_e", "eta_b", "mu", "nu", "rejection", "action_type"}
END_KEYS = {"mesh", "completed", "elements", "mean_eta", "domain", "task"}

QUAD = Domain(
    "quad",
    np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]),
    np.arange(4),
    np.array([[0, 1], [1, 2], [2, 3], [3, 0]]),
)

#: Never valid where V_0 is a corner: a new vertex on V_0 itself.
INVALID = np.array([0.0, -1.0, 0.0])


def episode(env: MeshEnv, seed: int, steps: int = 2000) -> list[tuple[Any, ...]]:
    """The steps of one episode of random actions."""
    env.reset(seed=seed)
    rng, taken = np.random.default_rng(seed), []
    for _ in range(steps):
        taken.append(env.step(rng.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32)))
        if taken[-1][2] or taken[-1][3]:
            break
    return taken


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("options", [{}, {"domain": "random:3", "type2": True}, {"observation": "O3", "radius": "R1"}])
def test_gymnasium_has_nothing_to_object_to(options: dict, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygame", FakePygame())
    env = gym.make("FreeMesh-v0", render_mode="rgb_array", **options)
    assert isinstance(env.unwrapped, MeshEnv)
    check_env(env.unwrapped)
    env.close()


def test_spaces() -> None:
    env = MeshEnv("T1")
    assert env.observation_space.shape == (15,)
    assert env.action_space == gym.spaces.Box(-1.0, 1.0, (3,), np.float32)
    assert MeshEnv("T1", type2=True).action_space.shape == (5,)
    assert MeshEnv("T1", observation="O3").observation_space.shape == (21,)
    assert (MeshEnv("T1", radius="R3").parameters.alpha, MeshEnv("T1", observation="O1").parameters.beta) == (3.0, 4.0)


def test_one_seed_one_episode() -> None:
    domains = ["T1", "random:11", "random:20"]
    first, second = (episode(MeshEnv(domains), 5) for _ in range(2))
    assert len(first) == len(second)
    for (o1, r1, *flags1, info1), (o2, r2, *flags2, info2) in zip(first, second, strict=True):
        np.testing.assert_array_equal(o1, o2)
        assert (r1, flags1) == (r2, flags2)
        assert {k: v for k, v in info1.items() if k != "mesh"} == {k: v for k, v in info2.items() if k != "mesh"}
    np.testing.assert_array_equal(first[-1][4]["mesh"].vertices, second[-1][4]["mesh"].vertices)


def test_the_seed_draws_the_domain() -> None:
    env = MeshEnv(["T1", "T2", "T3"])
    drawn = [env.reset(seed=seed)[1]["domain"] for seed in range(30)]
    assert set(drawn) == {"T1", "T2", "T3"}
    assert drawn == [env.reset(seed=seed)[1]["domain"] for seed in range(30)]
    env.reset(seed=3)
    after = [env.reset()[1]["domain"] for _ in range(30)]
    assert set(after) == {"T1", "T2", "T3"}


def test_results_do_not_change_afterwards() -> None:
    env = MeshEnv("T2")
    first, _ = env.reset(seed=0)
    kept = first.copy()
    episode(env, 0, steps=50)
    np.testing.assert_array_equal(first, kept)


@pytest.mark.parametrize("seed", range(4))
def test_infos(seed: int) -> None:
    taken = episode(MeshEnv("random:11"), seed)
    for observation, reward, terminated, truncated, info in taken:
        assert info.keys() == (STEP_KEYS | END_KEYS if terminated or truncated else STEP_KEYS)
        assert info["rejection"] in REJECTIONS
        assert info["action_type"] in ACTION_TYPES
        assert type(reward) is float
        assert type(terminated) is type(truncated) is bool
        assert observation.dtype == np.float32
        if info["rejection"]:
            assert reward == -0.1
        elif not terminated:
            assert reward == pytest.approx(info["eta_e"] + info["eta_b"] + info["mu"] + info["nu"])
    _, _, terminated, truncated, end = taken[-1]
    mesh = end["mesh"]
    assert isinstance(mesh, Mesh)
    assert terminated != truncated
    assert end["completed"] == mesh.complete == terminated
    assert end["elements"] == len(mesh.quads)
    assert (end["domain"], mesh.name) == ("random-11", "random-11")
    assert mesh.defects(load("random:11").area) == []


def test_truncated_after_invalid_actions_in_a_row() -> None:
    env = MeshEnv("T1", max_invalid=7)
    first, _ = env.reset(seed=0)
    for i in range(7):
        observation, reward, terminated, truncated, info = env.step(INVALID)
        np.testing.assert_array_equal(observation, first)
        assert (reward, terminated, truncated) == (-0.1, False, i == 6)
    assert (info["completed"], info["elements"], info["mean_eta"]) == (False, 0, 0.0)


def test_a_valid_action_forgives_the_invalid_ones() -> None:
    taken = episode(MeshEnv("random:20", max_invalid=25), 0)
    run, runs = 0, []
    for *_, info in taken:
        run = run + 1 if info["rejection"] else 0
        runs.append(run)
    assert max(runs[:-1]) < 25 < sum(bool(info["rejection"]) for *_, info in taken)
    assert taken[-1][3] == (runs[-1] == 25)


def test_truncated_at_the_element_cap() -> None:
    taken = episode(MeshEnv("T2", max_elements=3, max_invalid=10**6), 0)
    *_, terminated, truncated, info = taken[-1]
    assert (terminated, truncated) == (False, True)
    assert info["elements"] == sum(not info["rejection"] for *_, info in taken) == 3
    assert not info["mesh"].complete


def test_the_default_cap_is_four_times_the_area_in_mean_squares() -> None:
    domain = load("T1")
    sides = np.linalg.norm(domain.vertices - np.roll(domain.vertices, -1, axis=0), axis=1)
    cap = element_cap(domain, MeshingParameters())
    assert cap == int(4.0 * domain.area / sides.mean() ** 2) + len(domain.ring)
    assert MeshEnv(domain).episodes._caps.tolist() == [cap]


@pytest.mark.parametrize(("render_mode", "steps"), [("rgb_array", 0), ("rgb_array", 60), (None, 0)])
def test_render(render_mode: str | None, steps: int) -> None:
    env = MeshEnv("random:20", render_mode=render_mode)
    episode(env, 0, steps)
    picture = env.render()
    if render_mode is None:
        assert picture is None
    else:
        assert (picture.shape, picture.dtype) == ((512, 512, 3), np.uint8)
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 10
        assert 0.01 < (picture < 250).any(axis=2).mean() < 0.99


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"gama": 0.9}, "unknown environment option 'gama'; known: n, g, beta"),
        ({"observation": "O4"}, "observation = 'O4': use one of O1, O2, O3"),
        ({"radius": "R0"}, "radius = 'R0': use one of R1, R2, R3"),
        ({"n": 0}, r"MeshingParameters.n = 0: must be a whole number in \[1, 8\]"),
        ({"density": "dense"}, "density = 'dense': must be continuous or printed or local"),
        ({"beta": float("nan")}, "MeshingParameters.beta = nan"),
        ({"max_elements": 0}, "max_elements = 0: must be a whole number in"),
        ({"render_mode": "ansi"}, "render_mode = 'ansi': use 'human', 'rgb_array' or None"),
        ({"domain": QUAD}, "quad: a ring of 4 vertices is one element already; an episode needs at least 6"),
        ({"domain": []}, "no domain to mesh: give at least one"),
    ],
)
def test_bad_options_are_named(options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        MeshEnv(**options)


def test_an_unknown_domain_is_named() -> None:
    with pytest.raises(DomainError, match="T9"):
        MeshEnv("T9")


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([0.0, np.nan, 0.0], "action 0 is not finite"),
        ([0.0, 0.0, np.inf], "action 0 is not finite"),
        ([0.0, 0.0], r"actions have shape \(1, 2\), expected \(1, 3\)"),
    ],
)
def test_bad_actions_are_named_and_change_nothing(action: list[float], message: str) -> None:
    env = MeshEnv("T1")
    env.reset(seed=0)
    before = env.episodes.get_state()
    with pytest.raises(ValueError, match=message):
        env.step(np.array(action))
    for key, value in env.episodes.get_state()["arrays"].items():
        np.testing.assert_array_equal(value, before["arrays"][key])


def test_actions_are_clipped() -> None:
    wide, narrow = MeshEnv(generic("T2")), MeshEnv(generic("T2"))
    rng = np.random.default_rng(0)
    wide.reset(seed=0)
    narrow.reset(seed=0)
    for _ in range(30):
        action = rng.uniform(-2.0, 2.0, 3)
        np.testing.assert_array_equal(wide.step(action)[0], narrow.step(np.clip(action, -1.0, 1.0))[0])


# The task: which domains are drawn


def test_task_weights() -> None:
    task = Task([load(name) for name in ("T1", "T2", "T3")])
    assert task.get() == pytest.approx({"T1": 1 / 3, "T2": 1 / 3, "T3": 1 / 3})
    task.set({"T3": 3.0, "T1": 1.0})
    assert task.get() == {"T1": 0.25, "T2": 0.0, "T3": 0.75}
    rng = np.random.default_rng(0)
    drawn = np.bincount([task.draw(rng) for _ in range(4000)], minlength=3) / 4000
    np.testing.assert_allclose(drawn, [0.25, 0.0, 0.75], atol=0.03)


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        ({"T4": 1.0}, "task names T4; this environment has T1, T2"),
        ({"T1": -1.0, "T2": 2.0}, "none may be negative"),
        ({"T1": 0.0}, "one must be positive"),
        ({"T1": float("nan")}, "one must be positive"),
    ],
)
def test_bad_task_weights_are_named(weights: dict[str, float], message: str) -> None:
    task = Task([load("T1"), load("T2")])
    with pytest.raises(ValueError, match=message):
        task.set(weights)
    assert task.get() == {"T1": 0.5, "T2": 0.5}


def test_a_step_after_the_end_is_refused() -> None:
    """Kernels write without bounds checks: an episode that is over must not go on."""
    env = MeshEnv("T1", max_elements=3)
    env.reset(seed=0)
    random = np.random.default_rng(0)
    while True:
        _, _, terminated, truncated, _ = env.step(random.uniform(-1, 1, 3))
        if terminated or truncated:
            break
    with pytest.raises(ValueError, match="over"):
        env.step(np.zeros(3))
    env.reset()
    env.step(np.zeros(3))


def test_options_are_what_differs_from_the_parameters_given() -> None:
    base = MeshingParameters(n=3, beta=5.0, type2=True)
    assert MeshEnv(parameters=base).parameters == base
    assert MeshVectorEnv(2, parameters=base, n=1).parameters == replace(base, n=1)
    assert MeshEnv(parameters=base, observation="O1").parameters == replace(base, n=2, g=3, beta=4.0)


def test_compiled_code_gets_the_numbers_in_its_types() -> None:
    given = MeshingParameters(n=np.float32(3), beta=7, extended=np.True_, density="local")  # type: ignore[arg-type]
    compiled = numbers(given)
    assert (compiled.n, compiled.beta, compiled.extended, DENSITIES[compiled.density]) == (3, 7.0, True, "local")
    assert [type(value) for value in compiled] == [type(value) for value in numbers(MeshingParameters())]


def test_a_number_beside_a_name_has_its_way() -> None:
    assert MeshEnv("T1", observation="O2", n=4).parameters.n == 4
    with pytest.raises(ValueError, match="whole"):
        MeshEnv("T1", n=2.5)
