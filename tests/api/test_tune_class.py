"""`freemesh_ray.trainable` under Ray Tune's own parts, with an algorithm that learns nothing, fast."""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml
from fake_study import Fake
from process_tree import running
from ray import tune
from ray.tune.schedulers import AsyncHyperBandScheduler, PopulationBasedTraining

import freemesh_ray
from freemesh_ray.api.tune_class import MeshTrainable
from freemesh_ray.local_ray import local_ray
from freemesh_ray.policies.evaluation import RETURN
from freemesh_ray.policies.policy import Policy
from freemesh_ray.studies.trainable import TrainingTrainable
from freemesh_ray.tracking import mlflow_store, sync

pytestmark = pytest.mark.slow

FOLDERS = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
SPACE = {
    "curriculum.stages": ["T1"], "budget": {"env_steps": 600, "minutes": None}, "evaluation.interval": 200,
    "tracking.enabled": False,
}  # fmt: skip


class FakeTrainable(MeshTrainable):
    """With an algorithm that takes 100 steps an iteration."""

    def setup(self, config: Mapping[str, Any], callbacks: Any = ()) -> None:
        TrainingTrainable.setup(self, config, Fake, callbacks)


class Acts(freemesh_ray.Callback):
    """Stops a training of seed 1 at its first evaluation, and fails in one of seed 2."""

    def on_start(self, training: Any) -> None:
        self.seed = training.config["seed"]

    def on_evaluation(self, figures: Any) -> None:
        if self.seed == 1:
            raise freemesh_ray.StopTraining

    def on_iteration(self, status: Any) -> None:
        if self.seed == 2:
            raise LookupError("no such device")


def tuner(folder: Path, name: str, space: Mapping[str, Any], trainable: Any = FakeTrainable, **config: Any) -> Any:
    return tune.Tuner(
        trainable,
        param_space={**SPACE, **space},
        run_config=tune.RunConfig(
            name=name, storage_path=str(folder), verbose=0,
            checkpoint_config=tune.CheckpointConfig(checkpoint_frequency=1, num_to_keep=4),
        ),
        tune_config=tune.TuneConfig(metric=RETURN, mode="max", **config),
    )  # fmt: skip


def killed(folder: str) -> None:
    """What the process does that a test kills: trials that take long."""
    with local_ray(1):
        tuner(Path(folder), "killed", {"seed": tune.grid_search([1, 2])}).fit()


def has_checkpoint(experiment: Path) -> bool:
    """Whether Tune's record of an experiment, which is a second old at most, names a checkpoint."""
    try:
        trials = tune.ExperimentAnalysis(str(experiment)).trials or []
    except (OSError, ValueError):  # there is no record yet
        return False
    return any(trial.checkpoint is not None for trial in trials)


def environment(log: Path, pause: float) -> dict[str, str]:
    path = os.pathsep.join([*FOLDERS, os.environ.get("PYTHONPATH", "")])
    return {"PYTHONPATH": path, "FAKE_LOG": str(log), "FAKE_PAUSE": str(pause), "TUNE_GLOBAL_CHECKPOINT_S": "1"}


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every beginning and restored checkpoint is a line there."""
    path = tmp_path_factory.mktemp("log") / "log"
    path.touch()
    return path


@pytest.fixture(scope="module", autouse=True)
def own_ray(log: Path) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for name, value in environment(log, 0).items():
            patch.setenv(name, value)
        with local_ray(1):
            yield


def settings(result: Any) -> dict[str, Any]:
    read: dict[str, Any] = yaml.safe_load((Path(result.path) / "config.yaml").read_text())
    return read


def test_a_grid_is_a_trial_for_each_value_and_one_family_in_the_store(blank_database: Path, tmp_path: Path) -> None:
    shutil.copy(blank_database, tmp_path / "mlflow.db")
    gammas = {"learner.gamma": tune.grid_search([0.9, 0.99]), "tracking.enabled": True}
    results = tuner(tmp_path, "gammas", gammas).fit()
    assert not results.errors
    assert [settings(result)["learner"]["gamma"] for result in results] == [0.9, 0.99]
    assert [settings(result)["runners"]["count"] for result in results] == [0, 0]
    for result in results:
        assert result.metrics["env_steps"] == 600
        assert result.metrics["updates"] == 300
        assert result.metrics["seconds"] > 0
        scores = Policy.load(Path(result.path) / "policy.npz").about["scores"]
        assert scores.keys() <= result.metrics.keys()
        assert result.metrics_dataframe["env_steps"].tolist() == [200, 400, 600]
        assert (Path(result.path) / "learning_curve.png").is_file()

    assert sync(tmp_path, f"sqlite:///{tmp_path / 'mlflow.db'}") == 0
    client = mlflow_store.connect(f"sqlite:///{tmp_path / 'mlflow.db'}")
    runs = client.search_runs([client.get_experiment_by_name("freemesh").experiment_id])
    (parent,) = (run for run in runs if "mlflow.parentRunId" not in run.data.tags)
    children = [run for run in runs if run is not parent]
    assert (parent.info.run_name, len(children)) == ("gammas", 2)
    assert {run.data.tags["mlflow.parentRunId"] for run in children} == {parent.info.run_id}
    assert {run.data.params["learner.gamma"] for run in children} == {"0.9", "0.99"}
    assert {run.info.status for run in runs} == {"FINISHED"}
    points = client.get_metric_history(children[0].info.run_id, RETURN)
    assert [point.step for point in points] == [200, 400, 600]


def test_a_killed_experiment_goes_on_from_its_checkpoints(log: Path, tmp_path: Path) -> None:
    code = f"import test_tune_class; test_tune_class.killed({str(tmp_path)!r})"
    known = tmp_path / "killed"
    with running(["-c", code], tmp_path, {**os.environ, **environment(log, 1.0)}) as process:
        process.until(lambda: has_checkpoint(known), 200, "has written down that there is a checkpoint")
        process.process.kill()
        process.ended(60)
    begun = log.read_text().count("begin")
    before = {path.parent.name for path in known.glob("*/params.json")}
    restored = tune.Tuner.restore(str(known), FakeTrainable, resume_unfinished=True)
    results = restored.fit()
    assert [result.metrics["env_steps"] for result in results] == [600, 600]
    assert before <= {Path(result.path).name for result in results}
    went_on = [line for line in log.read_text().splitlines() if line.startswith("restore")]
    assert went_on
    assert all(int(line.split()[-1]) >= 200 for line in went_on)
    assert log.read_text().count("begin") - begun <= 2
    for result in results:
        lines = (Path(result.path) / "evaluations.jsonl").read_text()
        assert re.findall(r'"env_steps": (\d+)', lines) == ["200", "400", "600"]


def test_asha_stops_the_worse(tmp_path: Path) -> None:
    asha = AsyncHyperBandScheduler(time_attr="env_steps", max_t=601, grace_period=200, reduction_factor=2)
    seeds = {"seed": tune.grid_search([1, 2, 3])}
    results = tuner(tmp_path, "asha", seeds, scheduler=asha, max_concurrent_trials=1).fit()
    steps = [result.metrics["env_steps"] for result in results]
    assert not results.errors
    assert 600 in steps
    assert min(steps) < 600
    assert all((Path(result.path) / "policy.npz").is_file() for result in results)


def test_population_based_training_changes_settings_in_processes_that_stay(log: Path, tmp_path: Path) -> None:
    pbt = PopulationBasedTraining(
        time_attr="env_steps", perturbation_interval=200, quantile_fraction=0.5, resample_probability=1.0,
        hyperparam_mutations={"learner.gamma": tune.uniform(0.9, 0.99)}, synch=True,
    )  # fmt: skip
    space = {"learner.gamma": 0.901, "seed": tune.grid_search([1, 2])}
    restored = log.read_text().count("restore")
    results = tuner(tmp_path, "pbt", space, scheduler=pbt, reuse_actors=True).fit()
    assert [result.metrics["env_steps"] for result in results] == [600, 600]
    found = [settings(result)["learner"]["gamma"] for result in results]
    assert found == [result.config["learner.gamma"] for result in results]
    assert set(found) != {0.901}
    assert log.read_text().count("restore") > restored


WRONG = {
    r"settings: learner\.gamma: must be a number in \[0, 1\], not 7": {"gamma": 7},
    r"settings: learner\.gama: unknown key: did you mean learner\.gamma\?": {"gama": 0.9},
    r"settings: learner: is a section": 5,
}


def test_a_wrong_setting_is_the_trial_s_last_line(tmp_path: Path) -> None:
    results = tuner(tmp_path, "wrong", {"learner": tune.grid_search([*WRONG.values()])}).fit()
    for said, result in zip(WRONG, results, strict=True):
        lines = str(result.error).strip().splitlines()
        assert re.search(said, lines[-1]), result.error
        assert not any("freemesh_ray/config" in line for line in lines), "those before are not of how it was found"


def test_callbacks_come_with_it(tmp_path: Path) -> None:
    acts = tune.with_parameters(FakeTrainable, callbacks=[Acts()])
    stopped, failed = tuner(tmp_path, "acts", {"seed": tune.grid_search([1, 2])}, acts).fit()
    assert stopped.metrics["env_steps"] == 200
    assert (Path(stopped.path) / "finished.json").is_file()
    assert "callback Acts: on_iteration raised LookupError (no such device)" in str(failed.error).splitlines()[-1]
    assert list(Path(failed.path).glob("checkpoint_*/progress.json")), "nothing is lost"


def test_a_trial_takes_a_core_for_each_of_its_processes() -> None:
    def cores(config: dict[str, Any]) -> float:
        asked = freemesh_ray.trainable.default_resource_request(config)
        return sum(bundle["CPU"] for bundle in asked.bundles) if asked else 1

    assert cores({}) == 1
    assert cores({"runners": {"count": 3}}) == 4
    assert cores({"runners.count": 1, "learner.count": 2}) == 4
    assert cores({"runners.count": "many"}) == 1


def test_the_path_of_its_class_is_importable_everywhere() -> None:
    place: Callable[..., Any] = freemesh_ray.trainable
    assert (place.__module__, place.__qualname__) == ("freemesh_ray.api.tune_class", "MeshTrainable")
    assert place.__module__ in sys.modules
