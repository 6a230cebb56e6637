"""Faults done to real trainings, one at a time: a process killed, an environment that raises or hangs, a full disk, a
loss that is no number. Each training comes to its end, or ends in one line, and nothing that was checkpointed is lost.

docs/faults.md is the table of these tests; with ``pytest -rP`` they print its seconds.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_training import Fake
from told import told

from freemesh_ray import config
from freemesh_ray.algorithms.build import build
from freemesh_ray.local_ray import local_ray
from freemesh_ray.storage.atomic import OutputError
from freemesh_ray.training import checkpoint
from freemesh_ray.training.job import train
from freemesh_ray.training.run import Run
from freemesh_ray.training.run_folder import TrainingError
from freemesh_ray.training.status import Status

pytestmark = pytest.mark.slow

Harm = Callable[[Any], None]


@pytest.fixture(scope="module")
def ray() -> Iterator[None]:
    with local_ray(4):
        yield


class Patient:
    """A small real training that is harmed once, at ``at`` env steps."""

    def __init__(self, folder: Path, harm: Harm, at: int = 2500, sets: tuple[str, ...] = ()) -> None:
        self.settings = config.load(
            ["train_smoke"],
            [
                f"paths.runs={folder}", "name=patient", "tracking.enabled=false", "budget.env_steps=6000",
                "budget.minutes=null", "evaluation.interval=100000", "checkpoint.interval=1000", "runners.count=2",
                "learner.updates_per_step=0.05", *sets,
            ],
        )  # fmt: skip
        self.folder = folder / "patient"
        self.harm, self.at, self.healthy = harm, at, True
        self.notes: list[str] = []
        self.statuses: list[Status] = []
        #: When the harm was done, and when an iteration was over again.
        self.clock: list[float] = []

    def make(self, settings: Any) -> Any:
        """The algorithm, whose next iteration at ``at`` steps begins with the harm."""
        algorithm = build(settings)
        iterate = algorithm.train

        def harmed() -> dict[str, Any]:
            if self.healthy and algorithm.env_steps >= self.at:
                self.healthy = False
                self.clock.append(time.monotonic())
                self.harm(algorithm)
            results = iterate()
            if len(self.clock) == 1:
                self.clock.append(time.monotonic())
            return results

        algorithm.train = harmed
        return algorithm

    def train(self, **options: Any) -> Run:
        """To the end."""
        try:
            return train(
                self.settings, make=self.make, callbacks=told(self.statuses.append, self.notes.append), **options
            )
        finally:
            if len(self.clock) == 2:
                print(f"{self.clock[1] - self.clock[0]:.1f} s until an iteration was over again")

    def noted(self, text: str) -> bool:
        """Whether a line of the output has the text."""
        return any(text in note for note in self.notes)


def of_runner(algorithm: Any, which: int, function: Callable[[Any], Any]) -> Any:
    """What ``function`` of one env runner returns; it may not answer."""
    group = algorithm.env_runner_group
    return group.foreach_env_runner(function, local_env_runner=False, remote_worker_ids=[which], timeout_seconds=30)


def kill(algorithm: Any) -> None:
    """SIGKILL to the first env runner."""
    (pid,) = of_runner(algorithm, 1, lambda runner: os.getpid())
    os.kill(pid, signal.SIGKILL)


def raises(times: int) -> Harm:
    """An environment whose step raises so many times."""

    def harm(algorithm: Any) -> None:
        def spoil(runner: Any) -> None:
            env, left = runner.env.unwrapped, [times]
            step = env.step

            def bad(actions: Any) -> Any:
                if not left[0]:
                    return step(actions)
                left[0] -= 1
                raise ArithmeticError("an angle of no size")

            env.step = bad

        if algorithm.config.num_env_runners:
            of_runner(algorithm, 1, spoil)
        else:
            spoil(algorithm.env_runner)

    return harm


def runs_out_of_memory(killed: bool) -> Harm:
    """An environment that allocates until there is no more: an exception, or the system kills its process.

    It may have half a gigabyte more than it has, and holds at most that, so that the machine is not harmed.
    """

    def harm(algorithm: Any) -> None:
        def spoil(runner: Any) -> None:
            env = runner.env.unwrapped
            step = env.step

            def greedy(actions: Any) -> Any:
                env.step = step
                size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
                before = resource.getrlimit(resource.RLIMIT_AS)
                resource.setrlimit(resource.RLIMIT_AS, (size + 2**29, before[1]))
                try:
                    held = []
                    while True:
                        held.append(bytearray(2**26))
                except MemoryError:
                    if killed:
                        os.kill(os.getpid(), signal.SIGKILL)
                    raise
                finally:
                    resource.setrlimit(resource.RLIMIT_AS, before)

            env.step = greedy

        of_runner(algorithm, 1, spoil)

    return harm


def hang(algorithm: Any) -> None:
    """An environment whose step does not return."""

    def spoil(runner: Any) -> None:
        runner.env.unwrapped.step = lambda actions: time.sleep(10_000)

    of_runner(algorithm, 1, spoil)


def poison(algorithm: Any) -> None:
    """A weight of the critic that is no number."""

    def spoil(learner: Any) -> None:
        learner.module["default_policy"].critic.weights[0].data.fill_(float("nan"))

    algorithm.learner_group.foreach_learner(spoil)


def kill_learner(algorithm: Any) -> None:
    """SIGKILL to the learner's process."""
    (pid,) = (result.get() for result in algorithm.learner_group.foreach_learner(lambda learner: os.getpid()))
    os.kill(pid, signal.SIGKILL)


def test_an_env_runner_that_is_killed_is_replaced_and_the_others_go_on(ray: None, tmp_path: Path) -> None:
    patient = Patient(tmp_path, kill, sets=("budget.env_steps=60000",))
    pids: set[int] = set()

    def both_again() -> bool:
        """Stop as soon as there are two env runners again."""
        found = patient.algorithm.env_runner_group.foreach_env_runner(
            lambda runner: os.getpid(), local_env_runner=False, timeout_seconds=5
        )
        pids.update(found)
        if len(pids) == 3 and len(found) == 2:
            print(f"{time.monotonic() - patient.clock[0]:.1f} s until there were two env runners again")
            return True
        return False

    make = patient.make

    def made(settings: Any) -> Any:
        patient.algorithm = make(settings)
        return patient.algorithm

    patient.make = made  # type: ignore[method-assign]
    with pytest.raises(KeyboardInterrupt):
        patient.train(interrupted=both_again)
    assert patient.noted("env runner 1 failed (its process died); it begins anew")
    assert not patient.noted("going back")
    steps = [status.env_steps for status in patient.statuses]
    assert steps == sorted(set(steps))


def test_an_environment_that_raises_begins_new_episodes(ray: None, tmp_path: Path) -> None:
    patient = Patient(tmp_path, raises(1))
    assert patient.train().progress.env_steps >= 6000
    assert patient.noted("env runner 1 failed (ArithmeticError: an angle of no size); it begins anew")
    assert not patient.noted("going back")


@pytest.mark.skipif(sys.platform != "linux", reason="memory is told by /proc")
@pytest.mark.parametrize(("killed", "reason"), [(False, "MemoryError"), (True, "its process died")])
def test_an_env_runner_out_of_memory_begins_anew(killed: bool, reason: str, ray: None, tmp_path: Path) -> None:
    patient = Patient(tmp_path, runs_out_of_memory(killed), at=1200, sets=("budget.env_steps=4000",))
    assert patient.train().progress.env_steps >= 4000
    assert [note for note in patient.notes if "failed" in note] == [f"env runner 1 failed ({reason}); it begins anew"]
    assert not patient.noted("going back")


def test_so_does_one_in_the_training_s_own_process(ray: None, tmp_path: Path) -> None:
    patient = Patient(tmp_path, raises(2), sets=("runners.count=0",))
    assert patient.train().progress.env_steps >= 6000
    assert sum("env runner 0 failed" in note for note in patient.notes) == 2
    assert not patient.noted("going back")


def test_an_environment_that_always_raises_is_made_anew_from_the_last_checkpoint(ray: None, tmp_path: Path) -> None:
    patient = Patient(tmp_path, raises(10**9), sets=("runners.count=0",))
    assert patient.train().progress.env_steps >= 6000
    assert patient.noted("failed 6 times in a row: ArithmeticError: an angle of no size; going back to step_")


def test_an_environment_that_cannot_be_mended_ends_the_training_in_one_line(ray: None, tmp_path: Path) -> None:
    patient = Patient(tmp_path, raises(10**9), sets=("runners.count=0", "checkpoint.retries=0"))
    with pytest.raises(TrainingError, match=r"an angle of no size .*--resume goes on from step_00000\d+") as raised:
        patient.train()
    assert "\n" not in str(raised.value)
    assert patient.train(resume=True).progress.env_steps >= 6000


@pytest.mark.parametrize(("runners", "seconds"), [(2, 3), (1, 20)])
def test_an_environment_that_hangs_is_given_up_and_replaced(
    runners: int, seconds: int, ray: None, tmp_path: Path
) -> None:
    patient = Patient(tmp_path, hang, sets=(f"runners.count={runners}", f"runners.timeout={seconds}"))
    assert patient.train().progress.env_steps >= 6000
    assert patient.noted(f"env runner 1 failed (no answer within {seconds} s)")
    assert not patient.noted("going back")


def test_a_loss_that_is_no_number_goes_back_to_the_last_checkpoint(ray: None, tmp_path: Path) -> None:
    patient = Patient(tmp_path, poison, sets=("runners.count=0",))
    trained = patient.train()
    assert patient.noted("loss is nan at")
    assert patient.noted("going back to step_00000")
    for path in checkpoint.found(patient.folder / "checkpoints"):
        weights = checkpoint.read(path)[0]["learner_group"]["learner"]["rl_module"]["default_policy"]
        assert all(np.isfinite(weight).all() for weight in weights.values())
    assert trained.progress.env_steps >= 6000


def test_a_learner_that_is_killed_is_made_anew_from_the_last_checkpoint(ray: None, tmp_path: Path) -> None:
    patient = Patient(tmp_path, kill_learner, sets=("learner.count=1", "runners.count=0"))
    trained = patient.train()
    assert patient.noted("going back to step_00000")
    assert trained.progress.env_steps >= 6000
    assert "Traceback" in (patient.folder / "failures.log").read_text()


@pytest.mark.parametrize(
    ("number", "to_group"), [(signal.SIGINT, False), (signal.SIGTERM, True), (signal.SIGHUP, True)]
)
def test_a_signal_is_a_checkpoint_and_an_end(number: signal.Signals, to_group: bool, tmp_path: Path) -> None:
    """To the command, or to its process group, as `timeout` and a terminal that is closed send it."""
    command = [
        sys.executable, "-m", "freemesh_ray", "train", "--config", "train_smoke.yaml", "--resume", "--set",
        "runners.count=1", "--set", "tracking.enabled=false", "--set", "checkpoint.interval=100000", "--set",
        "evaluation.interval=100000", "--set", "budget.env_steps=1000000", "--set", "budget.minutes=null",
    ]  # fmt: skip
    process = subprocess.Popen(
        ["env", "--default-signal=HUP", *command], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, start_new_session=True,
    )  # fmt: skip
    assert process.stdout is not None
    while "step " not in (line := process.stdout.readline()):
        assert line, process.stderr.read() if process.stderr else ""
    (os.killpg if to_group else os.kill)(process.pid, number)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 130
    assert err == "freemesh: interrupted\n"
    (saved,) = checkpoint.found(tmp_path / "runs" / "smoke" / "checkpoints")
    steps = json.loads((saved / checkpoint.PROGRESS).read_text())["env_steps"]
    assert f"interrupted at {steps:,} steps; saved" in out


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of six megabytes."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=6m", "tmpfs", str(folder)]
    if os.geteuid() or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("a small file system can be mounted by root only")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


class Large(Fake):
    """A training whose checkpoints take 1.5 MB."""

    def get_state(self) -> dict[str, Any]:
        return super().get_state() | {"experience": np.zeros(1_500_000, dtype=np.uint8)}


def test_a_disk_that_is_full_costs_a_checkpoint_not_the_training(small_disk: Path) -> None:
    settings = config.load(
        ["train_smoke"],
        [
            f"paths.runs={small_disk}", "name=large", "tracking.enabled=false", "budget.env_steps=1000",
            "evaluation.interval=300", "evaluation.episodes=2", "checkpoint.interval=300",
        ],
    )  # fmt: skip
    ballast, notes = small_disk / "ballast", list[str]()

    def fill(status: Status) -> None:
        if status.env_steps == 400:
            ballast.write_bytes(bytes(3_500_000))

    with pytest.raises(OutputError, match=r"checkpoints: no checkpoint at 1,000 steps \(No space left on device\)"):
        train(settings, make=lambda _: Large(), callbacks=told(fill, notes.append))
    assert [note.split(";")[1] for note in notes] == [" training goes on, the next is tried later"] * 2
    (kept,) = checkpoint.found(small_disk / "large" / "checkpoints")
    assert checkpoint.read(kept)[0]["env_steps"] == 300
    assert not list(kept.parent.glob(".partial*"))

    ballast.unlink()
    assert train(settings, make=lambda _: Large(), resume=True).progress.env_steps == 1000
    newest, older = checkpoint.found(small_disk / "large" / "checkpoints")
    assert [checkpoint.read(path)[0]["env_steps"] for path in (newest, older)] == [1000, 900]
