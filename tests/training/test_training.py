"""The training loop with a fake algorithm: budget, evaluation, the best policy, checkpoints, interruption, resume."""

from __future__ import annotations

import errno
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from curricula import curriculum
from told import told

from envs.domains.load import load
from envs.types import MeshingParameters
from freemesh_ray import config
from freemesh_ray.algorithms.env_runner import Episode
from freemesh_ray.policies.evaluation import evaluate
from freemesh_ray.policies.policy import Policy
from freemesh_ray.tracking import MLflowRun
from freemesh_ray.training import checkpoint
from freemesh_ray.training.job import train
from freemesh_ray.training.loop import Training
from freemesh_ray.training.run_folder import RunError, RunFolder, TrainingError
from freemesh_ray.training.status import Progress, Status


class Fake:
    """Takes 100 steps an iteration; its network acts nearly uniformly; may be made to raise."""

    def __init__(self, interrupt_at: int | None = None) -> None:
        self.env_steps = self.updates = 0
        self.curriculum = curriculum("T1")
        self.finished: list[Any] = []
        self.interrupt_at = interrupt_at
        self.incidents: list[str] = []
        self.seeds: list[int] = []
        self.saved = 0

    def train(self) -> dict[str, Any]:
        self.env_steps += 100
        self.updates += 50
        if self.interrupt_at is not None and self.env_steps >= self.interrupt_at:
            self.interrupt_at = None
            raise KeyboardInterrupt
        self.finished.append(Episode("T1", 60, float(self.env_steps), True, 30, 0.5))
        return {"learners": {"default_policy": {"alpha": 0.1}}}

    def actor_weights(self) -> list[tuple[Any, Any]]:
        return [(np.zeros((15, 6), dtype=np.float32), np.array([0, 0, 0, 0.3, 0.3, 0.3], dtype=np.float32))]

    def critic_weights(self) -> list[tuple[Any, Any]]:
        return [(np.zeros((2, 18, 1), dtype=np.float32), np.zeros((2, 1), dtype=np.float32))]

    def evaluate(self) -> dict[str, Any]:
        policy = Policy(self.actor_weights(), MeshingParameters())
        return {mode: {"T1": figures} for mode, figures in evaluate(policy, load("T1"), 2, seed=0).items()}

    def get_state(self) -> dict[str, Any]:
        self.saved += 1
        return {"env_steps": self.env_steps, "updates": self.updates}

    def set_state(self, state: dict[str, Any]) -> None:
        self.env_steps, self.updates = state["env_steps"], state["updates"]

    def reseed(self, seed: int) -> None:
        self.seeds.append(seed)

    def stop(self) -> None:
        pass


def run(settings: dict[str, Any], fake: Fake, **options: Any) -> Any:
    return train(settings, make=lambda _: fake, **options)


def rows(settings: dict[str, Any]) -> list[dict[str, Any]]:
    path = Path(settings["paths"]["runs"]) / "fake" / "evaluations.jsonl"
    return [json.loads(line) for line in path.read_text().splitlines()]


@pytest.mark.slow
def test_it_trains_to_its_budget_and_evaluates_on_the_way(settings: dict[str, Any]) -> None:
    statuses: list[Status] = []
    trained = run(settings, Fake(), callbacks=told(report=statuses.append))
    assert trained.progress.env_steps == 1000
    assert [row["env_steps"] for row in rows(settings)] == [300, 600, 900, 1000]
    assert [status.env_steps for status in statuses] == list(range(100, 1001, 100))
    assert statuses[-1].completion_rate == 1.0
    assert statuses[-1].mean_return == pytest.approx(np.mean(range(100, 1001, 100)))
    assert trained.folder.policy.is_file()
    assert trained.folder.curve.is_file()
    assert trained.checkpoint.name == "step_000001000"


@pytest.mark.slow
def test_only_the_newest_checkpoints_are_kept(settings: dict[str, Any]) -> None:
    run(settings, Fake())
    found = checkpoint.found(Path(settings["paths"]["runs"]) / "fake" / "checkpoints")
    assert [path.name for path in found] == ["step_000001000", "step_000000800"]


@pytest.mark.slow
def test_an_interrupted_run_saves_and_goes_on_to_the_same_end(settings: dict[str, Any]) -> None:
    with pytest.raises(KeyboardInterrupt):
        run(settings, Fake(interrupt_at=600))
    fake = Fake()
    trained = run(settings, fake, resume=True)
    assert trained.progress.env_steps == 1000
    assert trained.progress.updates == 500


@pytest.mark.slow
def test_a_signal_stops_between_iterations_with_everything_saved(settings: dict[str, Any]) -> None:
    fake, asked = Fake(), iter([False, False, True])
    with pytest.raises(KeyboardInterrupt):
        run(settings, fake, interrupted=lambda: next(asked))
    (saved,) = checkpoint.found(Path(settings["paths"]["runs"]) / "fake" / "checkpoints")
    assert saved.name == "step_000000300"
    assert checkpoint.read(saved)[0] == {"env_steps": 300, "updates": 150}
    assert run(settings, Fake(), resume=True).progress.env_steps == 1000
    assert [row["env_steps"] for row in rows(settings)] == [300, 600, 900, 1000]


@pytest.mark.slow
def test_evaluations_after_the_checkpoint_are_made_once(settings: dict[str, Any]) -> None:
    """Killed at 700 with checkpoints at 400: the evaluation at 600 is made again and stands once."""
    with pytest.raises(KeyboardInterrupt):
        run(settings, Fake(interrupt_at=700))
    assert [row["env_steps"] for row in rows(settings)] == [300, 600]
    run(settings, Fake(), resume=True)
    assert [row["env_steps"] for row in rows(settings)] == [300, 600, 900, 1000]


@pytest.mark.slow
@pytest.mark.parametrize("change", ["learner.hidden=[3]", "env.density=printed", "env.observation=O1", "env.radius=R3"])
def test_a_run_does_not_go_on_as_another(change: str, settings: dict[str, Any]) -> None:
    run(settings, Fake())
    path = Path(settings["paths"]["runs"]) / "fake" / "config.yaml"
    before = path.read_text()
    other = config.load([path], [change])
    with pytest.raises(RunError, match=change.split("=")[0].split(".")[0]):
        run(other, Fake(), resume=True)
    assert path.read_text() == before


@pytest.mark.slow
def test_resuming_a_finished_run_keeps_its_checkpoint(settings: dict[str, Any]) -> None:
    run(settings, Fake())
    fake = Fake()
    run(settings, fake, resume=True)
    assert fake.saved == 0


@pytest.mark.slow
@pytest.mark.parametrize("damage", ["", "[]", "7", "{", '{"env_steps": 1000, "other": 1}'])
def test_damaged_progress_is_named(damage: str, settings: dict[str, Any]) -> None:
    settings["checkpoint"]["keep"] = 1
    trained = run(settings, Fake())
    (trained.checkpoint / "progress.json").write_text(damage)
    with pytest.raises(checkpoint.CheckpointError, match="step_000001000"):
        run(settings, Fake(), resume=True)


@pytest.mark.slow
def test_a_run_is_not_overwritten(settings: dict[str, Any]) -> None:
    run(settings, Fake())
    with pytest.raises(RunError, match="--resume"):
        run(settings, Fake())
    assert run(settings, Fake(), resume=True).progress.env_steps == 1000


@pytest.mark.slow
def test_resume_without_a_checkpoint_begins(settings: dict[str, Any]) -> None:
    assert run(settings, Fake(), resume=True).progress.env_steps == 1000


def test_the_time_budget_counts_all_sessions(settings: dict[str, Any], tmp_path: Path) -> None:
    settings["budget"] = {"env_steps": 10**9, "minutes": 1.0}
    training = Training(Fake(), settings, _folder(tmp_path), _no_tracking(tmp_path), progress=Progress(seconds=59.9))
    assert not training.done()
    training.progress.seconds = 60.0
    assert training.done()


def test_the_best_policy_is_the_one_that_completes_most(settings: dict[str, Any], tmp_path: Path) -> None:
    """Of two that complete nothing, the one with the higher return: standing still loses 10, acting wildly more."""
    fake = Fake()
    wild = fake.actor_weights()
    stuck = [(np.zeros((15, 6), dtype=np.float32), np.array([0, -9, 0, -9, -9, -9], dtype=np.float32))]
    training = Training(fake, settings, _folder(tmp_path), _no_tracking(tmp_path))
    training.folder.path.mkdir()
    fake.actor_weights = lambda: stuck  # type: ignore[method-assign]
    values = training.evaluate()
    first = training.progress.best
    assert first == [values["eval_deterministic/completion_rate"], values["eval_deterministic/return"]]
    training.progress.env_steps = 200
    fake.actor_weights = lambda: wild  # type: ignore[method-assign]
    assert training.evaluate()["eval_deterministic/return"] < first[1]
    assert training.progress.best == first
    assert training.progress.best_steps == 0
    training.progress.best = [-1.0, 0.0]
    training.evaluate()
    assert training.progress.best_steps == 200


def test_of_two_equally_good_policies_the_later_is_kept(settings: dict[str, Any], tmp_path: Path) -> None:
    training = Training(Fake(), settings, _folder(tmp_path), _no_tracking(tmp_path))
    training.folder.path.mkdir()
    for env_steps in (100, 200):
        training.progress.env_steps = env_steps
        training.evaluate()
        assert Policy.load(training.folder.policy).about["env_steps"] == training.progress.best_steps == env_steps


def test_a_checkpoint_cut_short_is_not_seen(tmp_path: Path) -> None:
    """What a kill in mid-save leaves behind."""

    class Dies(Fake):
        def get_state(self) -> dict[str, Any]:
            raise KeyboardInterrupt

    checkpoint.save(Fake(), {"env_steps": 1}, tmp_path, keep=2)
    with pytest.raises(KeyboardInterrupt):
        checkpoint.save(Dies(), {"env_steps": 2}, tmp_path, keep=2)
    assert [path.name for path in checkpoint.found(tmp_path)] == ["step_000000001"]
    checkpoint.save(Fake(), {"env_steps": 2}, tmp_path, keep=2)
    assert len(checkpoint.found(tmp_path)) == 2


def test_an_unreadable_checkpoint_is_named(tmp_path: Path) -> None:
    path = checkpoint.save(Fake(), {"env_steps": 1}, tmp_path, keep=2)
    (path / "progress.json").write_text("{")
    with pytest.raises(checkpoint.CheckpointError, match="step_000000001"):
        checkpoint.read(path)


def _folder(tmp_path: Path) -> RunFolder:
    return RunFolder(tmp_path / "run")


def _no_tracking(tmp_path: Path) -> MLflowRun:
    return MLflowRun(tmp_path, uri="", experiment="", name="", enabled=False)


class Fails(Fake):
    """Raises at the given env steps."""

    def __init__(self, at: float) -> None:
        super().__init__()
        self.at = at

    def train(self) -> dict[str, Any]:
        results = super().train()
        if self.env_steps >= self.at:
            raise RuntimeError("the learner is gone\nand more")
        return results


class Factory:
    """Algorithms of which the first fails at the first of the given env steps, the second at the second ..."""

    def __init__(self, *at: int) -> None:
        self.at = list(at)
        self.made: list[Fake] = []

    def __call__(self, _: Any) -> Fake:
        self.made.append(Fails(self.at.pop(0) if self.at else math.inf))
        return self.made[-1]


@pytest.mark.slow
def test_a_failure_goes_back_to_the_last_checkpoint_with_other_random_numbers(settings: dict[str, Any]) -> None:
    notes: list[str] = []
    factory = Factory(700)
    trained = train(settings, make=factory, callbacks=told(note=notes.append))
    assert trained.progress.env_steps == 1000
    assert [row["env_steps"] for row in rows(settings)] == [300, 600, 900, 1000]
    assert notes[0] == "the learner is gone; going back to step_000000400 (failure 1 in a row)"
    assert [fake.seeds for fake in factory.made] == [[], [1]]
    assert "Traceback" in (Path(settings["paths"]["runs"]) / "fake" / "failures.log").read_text()


@pytest.mark.slow
def test_a_failure_before_the_first_checkpoint_begins_anew(settings: dict[str, Any]) -> None:
    notes: list[str] = []
    trained = train(settings, make=Factory(350), callbacks=told(note=notes.append))
    assert trained.progress.env_steps == 1000
    assert [row["env_steps"] for row in rows(settings)] == [300, 600, 900, 1000]
    assert "going back to the start" in notes[0]


@pytest.mark.slow
def test_failures_with_checkpoints_in_between_are_not_counted_together(settings: dict[str, Any]) -> None:
    settings["checkpoint"]["retries"] = 1
    trained = train(settings, make=Factory(500, 900), callbacks=told(note=lambda line: None))
    assert trained.progress.env_steps == 1000


@pytest.mark.slow
def test_it_gives_up_in_one_line_and_can_be_resumed(settings: dict[str, Any]) -> None:
    settings["checkpoint"]["retries"] = 2
    factory = Factory(700, 700, 700)
    with pytest.raises(TrainingError, match=r"fake: the learner is gone \(failures.log has more\).*step_000000400"):
        train(settings, make=factory)
    assert len(factory.made) == 3
    assert train(settings, make=Factory(), resume=True).progress.env_steps == 1000


@pytest.mark.slow
def test_a_damaged_checkpoint_is_set_aside_for_the_one_before(settings: dict[str, Any]) -> None:
    run(settings, Fake())
    folder = Path(settings["paths"]["runs"]) / "fake" / "checkpoints"
    newest, older = checkpoint.found(folder)
    state = newest / checkpoint.STATE
    state.write_bytes(state.read_bytes()[:-100])
    notes: list[str] = []
    settings["budget"]["env_steps"] = 1200
    assert run(settings, Fake(), resume=True, callbacks=told(note=notes.append)).progress.env_steps == 1200
    assert notes[0].startswith(f"{newest}: unreadable checkpoint")
    assert "going back to the one before" in notes[0]
    assert notes[1].startswith(f"going on from {older}")
    assert (folder / f".damaged_{newest.name}").is_dir()


@pytest.mark.slow
def test_without_a_sound_checkpoint_a_run_is_not_silently_begun_anew(settings: dict[str, Any]) -> None:
    run(settings, Fake())
    for path in checkpoint.found(Path(settings["paths"]["runs"]) / "fake" / "checkpoints"):
        (path / checkpoint.STATE).write_bytes(b"")
    with pytest.raises(checkpoint.CheckpointError, match="there is no older one"):
        run(settings, Fake(), resume=True)


@pytest.mark.slow
def test_a_checkpoint_that_cannot_be_written_is_tried_again_later(
    settings: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    save, full = checkpoint.save, [True]

    def sometimes(*arguments: Any) -> Path:
        if full and full.pop():
            raise OSError(errno.ENOSPC, "No space left on device")
        return save(*arguments)

    monkeypatch.setattr(checkpoint, "save", sometimes)
    notes: list[str] = []
    trained = run(settings, Fake(), callbacks=told(note=notes.append))
    assert trained.progress.env_steps == 1000
    assert "no checkpoint at 400 steps (No space left on device); training goes on" in notes[0]
    found = checkpoint.found(Path(settings["paths"]["runs"]) / "fake" / "checkpoints")
    assert [path.name for path in found] == ["step_000001000", "step_000000800"]
