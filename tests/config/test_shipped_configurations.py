"""Every file of ``tune_configs``, shrunk and run: through all its stages, checkpoints and a kill, on to its end."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from ray import tune
from told import told

import tune_configs
from envs.domains.load import source
from freemesh_ray import config
from freemesh_ray.algorithms.build import configured
from freemesh_ray.local_ray import local_ray
from freemesh_ray.studies import definition
from freemesh_ray.studies.completion_mark import finished
from freemesh_ray.studies.definition import Study
from freemesh_ray.studies.plan import SearchPlan, Trial, VariantPlan, default_point, variant_plan
from freemesh_ray.studies.trainable import TrialTrainable
from freemesh_ray.training import checkpoint
from freemesh_ray.training.job import train
from freemesh_ray.training.loop import Algorithm
from freemesh_ray.training.run_folder import RunFolder
from freemesh_ray.training.status import Status

pytestmark = pytest.mark.slow

FILES = sorted(Path(tune_configs.__file__).parent.glob("*.yaml"))
STUDIES = [path for path in FILES if "study" in yaml.safe_load(path.read_text())]
TRAININGS = [path for path in FILES if path not in STUDIES]
#: Env steps of an iteration, and of a stage.
ITERATION, STAGE = 64, 128
#: What is smaller than as shipped, and what keeps it in one process and one folder.
SHRUNK: dict[str, Any] = {
    "env": {"max_invalid": 8},
    "curriculum": {"max_stage_steps": STAGE},
    "learner": {"batch_size": 16, "buffer_size": 1000, "updates_per_step": 0.1, "warmup_steps": ITERATION},
    "ppo": {"rollout_steps": ITERATION, "epochs": 1, "minibatch_size": 32},
    "runners": {"count": 0, "envs_per_runner": 4},
    "evaluation": {"interval": 10**9, "episodes": 1},
    "checkpoint": {"interval": 1, "retries": 0},
    "tracking": {"enabled": False},
}


class Killed(BaseException):
    """What no part of a training recovers from."""


@pytest.fixture(scope="module", autouse=True)
def ray() -> Iterator[None]:
    with local_ray(1):
        yield


def shrunk(tree: Mapping[str, Any], runs: Path, **evaluation: int) -> dict[str, Any]:
    """A tree that goes through its stages in a second or so, and on in the last."""
    small = deepcopy(dict(tree))
    for section, values in SHRUNK.items():
        small[section] |= values
    small["evaluation"] |= evaluation
    small["paths"]["runs"] = str(runs)
    small["budget"] = {"env_steps": len(stages(tree)) * STAGE + 3 * ITERATION, "minutes": None}
    return small


def stages(tree: Mapping[str, Any]) -> list[str]:
    """The names of a tree's stages, in order."""
    return [source(stage).name for stage in tree["curriculum"]["stages"]]


def make(tree: Mapping[str, Any]) -> Algorithm:
    """The tree's algorithm, with short iterations.

    In a thread of its own: RLlib looks through the whole stack for each of its parts, and a test's is long.
    """
    algorithm = configured(tree).reporting(min_sample_timesteps_per_iteration=ITERATION)
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(algorithm.build_algo).result()


def stage_of(saved: Path) -> int:
    """The stage that a checkpoint was written in."""
    return int(checkpoint.read(saved)[0]["curriculum"]["stage"])


def evaluated(folder: RunFolder) -> list[dict[str, Any]]:
    """The rows of a run's evaluations."""
    return [json.loads(line) for line in folder.evaluations.read_text().splitlines()]


@pytest.mark.parametrize("path", TRAININGS, ids=lambda path: path.stem)
def test_a_training_is_killed_in_its_last_stage_and_goes_on_to_its_end(path: Path, tmp_path: Path) -> None:
    tree = shrunk(config.load([path]), tmp_path)
    folder, names = RunFolder(tmp_path / tree["name"]), stages(tree)
    before: list[Status] = []
    after: list[Status] = []
    notes: list[str] = []

    def kill(status: Status) -> None:
        before.append(status)
        if [status.stage for status in before].count(names[-1]) == 3:
            raise Killed

    with pytest.raises(Killed):
        train(tree, make=make, callbacks=told(report=kill))
    newest = checkpoint.found(folder.checkpoints)[0]
    at = checkpoint.read(newest)[1]["env_steps"]
    assert stage_of(newest) == len(names) - 1
    assert at == before[-2].env_steps < before[-1].env_steps

    trained = train(tree, make=make, resume=True, callbacks=told(report=after.append, note=notes.append))
    assert any(f"going on from {newest} " in note for note in notes)
    assert list(dict.fromkeys(status.stage for status in before + after)) == names
    assert {status.stage for status in after} == {names[-1]}
    assert at < after[0].env_steps < at + 2 * ITERATION
    assert trained.progress.env_steps >= tree["budget"]["env_steps"]
    assert trained.checkpoint == checkpoint.found(folder.checkpoints)[0] != newest
    assert len(trained.stages) == len(names)
    assert trained.folder.policy.is_file()
    (row,) = evaluated(folder)
    assert all(f"eval_deterministic/{name}/return" in row for name in names)
    assert not folder.failures.exists()


def trials(study: Study, runs: Path) -> dict[str, Trial]:
    """A trial of each of the study's variants; of a search one of its own settings, and one of its space's ends."""
    if study.search is None:
        every = variant_plan(study, source={}).trials.values()
        chosen = list({trial.label: trial for trial in reversed(every)}.values())
    else:
        ends = {key: space.values[-1] for key, space in study.search.space.items()}
        points = enumerate([default_point(study), ends])
        chosen = [SearchPlan(study, runs).trainings(point, str(i))[0] for i, point in points]
    return {trial.name: replace(trial, config=shrunk(trial.config, runs, interval=1)) for trial in chosen}


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.stem)
def test_a_study_s_trials_are_killed_and_go_on_to_their_ends(path: Path, tmp_path: Path) -> None:
    study = definition.load(path)
    plan = VariantPlan(trials(study, tmp_path / "runs"))
    begin: Callable[..., TrialTrainable] = tune.with_parameters(TrialTrainable, plan=plan, make=make)
    populated = study.search is not None and study.search.scheduler == "pbt"
    for i, (name, trial) in enumerate(plan.trials.items()):
        last = len(stages(trial.config)) - 1
        first, saved = begin(config={"trial": name}), tmp_path / f"checkpoint-{i}"
        saved.mkdir()
        while first.step()["env_steps"] <= last * STAGE + ITERATION:
            pass
        first.save_checkpoint(str(saved))
        assert stage_of(saved) == last
        at = checkpoint.read(saved)[1]["env_steps"]
        assert first.step()["env_steps"] > at  # and is gone with it
        first.release()  # as the kernel does for a process that is killed

        second, rows = begin(config={"trial": name}), []
        # Population based training lets a trial go on from another one's checkpoint.
        second.load_checkpoint(str(tmp_path / "checkpoint-0" if populated else saved))
        while not rows or not rows[-1]["done"]:
            rows.append(second.step())
        assert at < rows[0]["env_steps"] < at + 2 * ITERATION
        assert rows[-1]["env_steps"] >= trial.config["budget"]["env_steps"]
        done = finished(trial.folder)
        assert done is not None
        assert done["env_steps"] == rows[-1]["env_steps"]
        steps = [row["env_steps"] for row in evaluated(trial.folder)]
        assert steps == sorted(set(steps))
        assert trial.folder.policy.is_file()
        for part in (first, second):
            part.cleanup()
