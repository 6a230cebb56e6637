"""`freemesh_ray.train` and `study` in a process of a user's own, whose Ray they use."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from subprocess import run
from typing import Any

import pytest
import ray

import freemesh_ray
from freemesh_ray.config import ConfigError
from freemesh_ray.local_ray import local_ray
from freemesh_ray.policies.evaluation import COMPLETION, SCORE
from freemesh_ray.policies.policy import Policy
from freemesh_ray.studies.study_folder import StudyError
from freemesh_ray.training import stop_signal
from freemesh_ray.training.run_folder import RunError

#: One iteration takes some 1,024 env steps, without those that begin episodes.
TINY = {
    "curriculum.stages": ["T1"], "runners": {"count": 0}, "budget": {"env_steps": 2000, "minutes": None},
    "evaluation": {"interval": 1000, "episodes": 1}, "tracking.enabled": False,
    "learner": {"hidden": (8,), "warmup_steps": 100, "batch_size": 16, "updates_per_step": 0.01},
}  # fmt: skip
pytestmark = pytest.mark.slow


def test_to_import_it_takes_neither_ray_nor_torch() -> None:
    code = "import sys, freemesh_ray; sys.exit(bool(sys.modules.keys() & {'ray', 'torch', 'mlflow', 'numba'}))"
    assert run([sys.executable, "-c", code], timeout=60).returncode == 0
    assert set(freemesh_ray.__all__) >= {"Callback", "StopTraining", "study", "train", "trainable"}
    assert all(getattr(freemesh_ray, name) is not None for name in freemesh_ray.__all__)


@pytest.fixture(scope="module", autouse=True)
def own_ray() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:  # trials import the callbacks of this file
        patch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=os.pathsep)
        with local_ray(1):
            yield


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("FREEMESH_HOME", str(tmp_path))
    return tmp_path


class Steps(freemesh_ray.Callback):
    """Keeps the env steps of iterations; acts at the first."""

    def __init__(self, act: Any = lambda: None) -> None:
        self.steps: list[int] = []
        self.act = act

    def on_iteration(self, status: Any) -> None:
        self.steps.append(status.env_steps)
        if len(self.steps) == 1:
            self.act()


def test_a_training_is_silent_and_leaves_a_run(home: Path, capfd: pytest.CaptureFixture[str]) -> None:
    steps = Steps()
    trained = freemesh_ray.train({"name": "first", **TINY}, callbacks=[steps])
    assert capfd.readouterr() == ("", "")
    assert ray.is_initialized(), "the user's Ray stays"
    assert trained.folder.path == home / "runs" / "first"
    assert len(steps.steps) == 2
    assert [row["env_steps"] for row in trained.evaluations] == steps.steps
    assert trained.progress.env_steps == steps.steps[-1] >= 2000
    assert trained.policy.about == Policy.load(trained.folder.policy).about
    assert trained.checkpoint == trained.folder.checkpoints / f"step_{steps.steps[-1]:09d}"
    assert trained.folder.curve.is_file()
    assert trained.folder.meshes.is_dir() == bool(trained.stages[0].files)
    with pytest.raises(RunError, match="already holds a run"):
        freemesh_ray.train({"name": "first", **TINY})
    with pytest.raises(ConfigError, match=r"learner\.gama: unknown key: did you mean learner\.gamma\?"):
        freemesh_ray.train({"learner": {"gama": 1}})


@pytest.mark.parametrize("settings", [5, [1, 2], [{"seed": 1}, None], None])
def test_settings_that_are_none_are_one_line(settings: Any) -> None:
    with pytest.raises(ConfigError, match=r"^settings: .*: give a mapping, a YAML file, or a list of these$"):
        freemesh_ray.train(settings)


def test_files_are_settings_too_and_the_ready_made_line_shows_progress(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.yaml").write_text("name: mine\nbudget.env_steps: 100\n")
    line = freemesh_ray.ProgressLine()
    trained = freemesh_ray.train([TINY, tmp_path / "mine.yaml"], callbacks=[line])
    assert 100 <= trained.progress.env_steps < 2000
    assert f"T1  step {trained.progress.env_steps:,}/100" in capfd.readouterr().out


@pytest.mark.parametrize("hangs", [False, True])
def test_ctrl_c_saves_a_checkpoint_and_resume_goes_on(hangs: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stop_signal, "LAST_SECONDS", 0.2 if hangs else 60.0)

    def interrupt() -> None:
        signal.raise_signal(signal.SIGINT)
        if hangs:
            threading.Event().wait(60)
            raise AssertionError("it was not interrupted")

    before = signal.getsignal(signal.SIGINT)
    settings = {"name": "cut", **TINY}
    with pytest.raises(KeyboardInterrupt):
        freemesh_ray.train(settings, callbacks=[Steps(interrupt)])
    assert signal.getsignal(signal.SIGINT) is before
    threading.Event().wait(0.5)  # nothing comes later
    steps = Steps()
    assert freemesh_ray.train(settings, callbacks=[steps], resume=True).progress.env_steps >= 2000
    assert len(steps.steps) == 1, "the other iteration was made before"


def test_a_training_in_a_thread_leaves_signals_alone() -> None:
    found: list[Any] = []
    thread = threading.Thread(target=lambda: found.append(freemesh_ray.train({"name": "threaded", **TINY})))
    thread.start()
    thread.join(120)
    assert found[0].progress.env_steps >= 2000


class Stops(freemesh_ray.Callback):
    """Writes into the trial's folder; stops those of seed 2 at their first evaluation."""

    def on_start(self, training: Any) -> None:
        self.training = training

    def on_evaluation(self, figures: Any) -> None:
        path = self.training.folder.path / "told"
        path.write_text(f"{os.getpid()} {figures['env_steps']}\n")
        if self.training.config["seed"] == 2:
            raise freemesh_ray.StopTraining


def test_a_study_from_a_mapping(home: Path, capfd: pytest.CaptureFixture[str]) -> None:
    asked = {
        "study": {"title": "Two batches!", "seeds": (1, 2), "variants": {"small": {"learner.batch_size": 8}}},
        "settings": TINY,
    }
    lines: list[str] = []
    done = freemesh_ray.study(asked, callbacks=[Stops()], note=lines.append)
    assert capfd.readouterr() == ("", "")
    assert lines[0].startswith("Two batches!\n2 trials of 2,000 env steps")
    assert "RAY_CHDIR_TO_TRIAL_DIR" not in os.environ
    assert done.folder.path == home / "studies" / "two-batches"
    assert [(trial.label, trial.seed, trial.status) for trial in done.trials] == [
        ("small", 1, "finished"), ("small", 2, "finished"),
    ]  # fmt: skip
    assert [len(trial.evaluations) for trial in done.trials] == [2, 1]
    assert all(trial.policy is not None and trial.figures.keys() >= {SCORE, COMPLETION} for trial in done.trials)
    assert done.best in done.trials
    assert "report.md" in [path.name for path in done.report]
    told = [(trial.folder.path / "told").read_text().split() for trial in done.trials]
    assert [int(steps) for _, steps in told] == [trial.evaluations[-1]["env_steps"] for trial in done.trials]
    assert str(os.getpid()) not in [pid for pid, _ in told]
    with pytest.raises(StudyError, match="already holds a study"):
        freemesh_ray.study(asked)
    assert freemesh_ray.study(asked, resume=True).best == done.best


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"study": {"title": "A", "seeds": [1], "variants": {"a": {"x": 1}}}}, "x: unknown key"),
        ({"study": {"title": object()}}, "study: holds what is no text"),
        ({"settings": {}}, "has no part `study`"),
        ({}, "has no part `study`"),
    ],
)
def test_a_mapping_that_is_no_study_is_one_line(asked: Any, said: str) -> None:
    with pytest.raises(ConfigError, match=said) as raised:
        freemesh_ray.study(asked)
    assert "\n" not in str(raised.value)
