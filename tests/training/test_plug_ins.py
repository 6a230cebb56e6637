"""Plug-ins in trainings: what they change, that one that fails ends its training in one line after a checkpoint, and
that a training with them goes on.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plugged import Write, modules

from envs.domains.load import load
from envs.errors import PluginError
from envs.plug_ins.environment_parts import NONE
from freemesh_ray import config
from freemesh_ray.algorithms.build import build
from freemesh_ray.algorithms.env_runner import Failure
from freemesh_ray.algorithms.mesh_algorithm import MeshAlgorithm
from freemesh_ray.local_ray import local_ray
from freemesh_ray.mesher import mesh_domain
from freemesh_ray.policies.policy import Policy, PolicyError
from freemesh_ray.training import checkpoint
from freemesh_ray.training.job import train
from freemesh_ray.training.run import Run
from freemesh_ray.training.run_folder import RunError

pytestmark = pytest.mark.slow

SOURCE = """
import gymnasium as gym
import numpy as np
from envs.mdp.observation import bounds
from freemesh_ray.training.callback import Callback

def paper(step): return step.reward
def doubled(step): return 2 * step.reward
def nan(step): return float("nan")

calls = 0
def late(step):
    global calls
    calls += 1
    if calls > 900:
        raise ValueError("late")
    return step.reward

class Paper:
    def __init__(self, parameters): self.low, self.high = bounds(parameters)
    def __call__(self, view): return view.observation

class Idle(gym.Wrapper): pass

class Half(gym.ObservationWrapper):
    def __init__(self, env):
        super().__init__(env)
        space = env.observation_space
        self.observation_space = gym.spaces.Box(space.low[:8], space.high[:8])
    def observation(self, observation): return observation[:8]

def square(random):
    x = np.array([0, 1, 2, 2, 2, 1, 0, 0])
    return (1 + random.random()) * np.stack([x, np.roll(x, 2)], axis=1)

def quads(episode): return len(episode.mesh.quads)
def bad(episode): return {"return": 1.0}

class Told(Callback):
    def on_evaluation(self, figures): open(FILE, "a").write("told ")
"""
TINY = {
    "tracking.enabled": False, "runners.count": 0, "runners.envs_per_runner": 4, "curriculum.stages": ["T1"],
    "learner.hidden": [16], "learner.batch_size": 32, "learner.buffer_size": 2000, "learner.warmup_steps": 200,
    "learner.updates_per_step": 0.1, "budget.env_steps": 1200, "budget.minutes": None, "evaluation.interval": 600,
    "evaluation.episodes": 2, "checkpoint.interval": 400, "env.max_invalid": 20,
}  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def ray() -> Iterator[None]:
    with local_ray(2):
        yield


@pytest.fixture
def write(tmp_path: Path) -> Iterator[Write]:
    with modules(tmp_path) as write:
        yield write


Trained = Callable[..., Run]


@pytest.fixture
def module(write: Write, tmp_path: Path) -> str:
    return write(SOURCE.replace("FILE", repr(str(tmp_path / "told"))))


@pytest.fixture
def trained(tmp_path: Path) -> Trained:
    def run(name: str = "run", resume: bool = False, interrupt_at: float = np.inf, **settings: Any) -> Run:
        own = {key.replace("__", "."): value for key, value in settings.items()}
        tree = config.load([TINY, {"name": name, "paths.runs": str(tmp_path / "runs")}, own])
        made: list[Any] = []

        def make(settings: Any) -> Any:
            made.append(build(settings))
            return made[-1]

        return train(tree, resume=resume, make=make, interrupted=lambda: made[-1].env_steps >= interrupt_at)

    return run


def same(one: Run, other: Run) -> bool:
    pairs = zip(one.policy.layers, other.policy.layers, strict=True)
    return all(np.array_equal(a, b) for layer in pairs for a, b in zip(*layer, strict=True))


def figures(run: Run) -> list[dict[str, float]]:
    return [{key: value for key, value in row.items() if key != "seconds"} for row in run.evaluations]


def test_the_paper_s_own_by_way_of_plug_ins_is_the_same_training_to_the_last_bit(trained: Trained, module: str) -> None:
    plain = trained("plain")
    by_name = trained("by-name", env__reward=f"{module}:paper", env__observe=f"{module}:Paper")
    wrapped = trained("wrapped", env__wrappers=[f"{module}:Idle"])
    for other in (by_name, wrapped):
        assert same(plain, other)
        assert figures(plain) == figures(other)
    assert plain.policy.critic
    assert not by_name.policy.critic, "the critics expect another reward than the mesher weighs"


def test_a_doubled_reward_doubles_the_returns_of_training_and_evaluation(trained: Trained, module: str) -> None:
    random = {"learner__warmup_steps": 10**6, "budget__env_steps": 600}  # the same actions, whatever is learnt
    plain, doubled = trained("plain", **random), trained("doubled", env__reward=f"{module}:doubled", **random)
    assert doubled.policy.plug_ins.reward == f"{module}:doubled"
    assert Policy.load(doubled.folder.policy).plug_ins == NONE, "a file does not name what is imported"
    for one, other in zip(figures(plain), figures(doubled), strict=True):
        assert one["eval_stochastic/return"] != 0
        for key, value in one.items():
            assert other[key] == pytest.approx(2 * value if key.endswith("return") else value), key


def test_a_policy_that_sees_otherwise_meshes_in_its_environment_alone(trained: Trained, module: str) -> None:
    run = trained(env__wrappers=[f"{module}:Half"], curriculum__stages=[f"{module}:square"], env__max_invalid=100)
    policy = run.policy
    assert policy.layers[0][0].shape[0] == 8
    (stage,) = run.stages
    assert stage.domain == "square-held-out-0"
    assert set(stage.meshes) == {"raw", "finished"}, stage.reason
    assert not stage.meshes["finished"].defects()
    words = r"was trained with env.wrappers = .*:Half, and meshes in that environment alone"
    with pytest.raises(PolicyError, match=words):
        Policy.load(run.folder.policy)
    with pytest.raises(PolicyError, match=words):
        mesh_domain(policy, load("T1"))


def test_metrics_are_recorded_and_callbacks_called(trained: Trained, module: str, tmp_path: Path) -> None:
    run = trained(evaluation__metrics=[f"{module}:quads"], callbacks=[f"{module}:Told"])
    assert len(run.evaluations) >= 2
    for row in run.evaluations:
        for mode in ("deterministic", "stochastic"):
            assert row[f"eval_{mode}/quads"] == row[f"eval_{mode}/T1/quads"] == row[f"eval_{mode}/elements"]
    assert (tmp_path / "told").read_text().split() == ["told"] * len(run.evaluations)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"env.reward": "missing_module:f"}, "env.reward: missing_module:f: no module missing_module"),
        ({"env.reward": "MODULE:nan"}, "env.reward: MODULE:nan: returned nan"),
        ({"env.reward": "MODULE:Idle"}, "env.reward: MODULE:Idle: is the class Idle"),
        ({"env.observe": "MODULE:nan"}, "env.observe: MODULE:nan: is a function"),
        ({"env.wrappers": ["MODULE:Paper"]}, "env.wrappers: MODULE:Paper: is the class Paper"),
        ({"curriculum.stages": ["MODULE:doubled"]}, "curriculum.stages: MODULE:doubled: raised AttributeError"),
        ({"evaluation.metrics": ["MODULE:Half"]}, "evaluation.metrics: MODULE:Half: is the class Half"),
        ({"callbacks": ["MODULE:Half"]}, "callbacks: MODULE:Half: is the class Half"),
        ({"algorithm": "MODULE:Half"}, "algorithm: MODULE:Half: is of type type"),
    ],
)
def test_what_cannot_be_had_is_told_before_anything_is_begun(
    settings: dict[str, Any], words: str, trained: Trained, module: str, tmp_path: Path
) -> None:
    own = json.loads(json.dumps(settings).replace("MODULE", module))
    with pytest.raises(PluginError) as caught:
        trained(**own)
    assert str(caught.value).startswith(words.replace("MODULE", module))
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("count", [0, 2])
def test_one_that_raises_ends_the_training_after_a_checkpoint_and_once(
    count: int, trained: Trained, module: str, tmp_path: Path
) -> None:
    own = {"env__reward": f"{module}:late", "runners__count": count, "checkpoint__interval": 10**6}
    with pytest.raises(PluginError) as caught:
        trained(**own, budget__env_steps=4000, learner__updates_per_step=0.01)
    saved = checkpoint.found(tmp_path / "runs" / "run" / "checkpoints")
    assert len(saved) == 1
    place = tmp_path / f"{module}.py"
    line = SOURCE.splitlines().index('        raise ValueError("late")') + 1
    told = f"env.reward: {module}:late: raised ValueError: late ({place}:{line}): mend it"
    assert str(caught.value) == f"{told}; --resume goes on from {saved[0]}"
    assert int(saved[0].name.removeprefix("step_")) >= 400

    place.write_text(place.read_text().replace("900", "10**9"))
    del sys.modules[module]
    run = trained(**own, resume=True, budget__env_steps=1600)
    assert run.progress.env_steps >= 1600


class Calls(list):
    """Answers of env runners, given once."""

    def answers(self) -> dict[int, Any]:
        found = dict(enumerate(self))
        self.clear()
        return found


def test_a_failure_that_is_found_while_a_checkpoint_is_saved_does_not_keep_it_from_being_saved() -> None:
    algorithm = MeshAlgorithm.__new__(MeshAlgorithm)
    vars(algorithm).update(
        _wanted=None, _calls=Calls(["answer", Failure("a plug-in: raised", plugged=True)]), _failures=Counter(),
        _fault=None, _silent=None, hurried=lambda: False,
    )  # fmt: skip
    assert algorithm._answers() == ["answer"]  # as `get_state` asks
    with pytest.raises(PluginError, match="a plug-in: raised"):
        algorithm._from_runners()


def test_a_metric_that_fails_loses_nothing(trained: Trained, module: str, tmp_path: Path) -> None:
    with pytest.raises(PluginError, match=r"bad: calls a figure 'return': give it a name of its own.* goes on from"):
        trained(evaluation__metrics=[f"{module}:bad"])
    assert checkpoint.found(tmp_path / "runs" / "run" / "checkpoints")


@pytest.mark.parametrize("setting", [{"env__reward": "paper", "env__observe": "Paper"}, {"env__wrappers": ["Idle"]}])
def test_a_training_goes_on_with_its_plug_ins_and_not_with_others(
    setting: dict[str, Any], trained: Trained, module: str
) -> None:
    own = {
        key: [f"{module}:{each}" for each in value] if isinstance(value, list) else f"{module}:{value}"
        for key, value in setting.items()
    }
    whole = trained("whole", **own)
    with pytest.raises(KeyboardInterrupt):
        trained("parts", **own, interrupt_at=700)
    for key in own:
        with pytest.raises(RunError, match=f"begun with {key.replace('__', '.')} = "):
            trained("parts", **{**own, key: None if key != "env__wrappers" else []}, resume=True)
    parts = trained("parts", **own, resume=True)
    assert parts.progress.env_steps >= 1200
    if "env__wrappers" not in own:  # whose state nobody knows
        assert parts.progress.env_steps == whole.progress.env_steps
        assert same(parts, whole)
