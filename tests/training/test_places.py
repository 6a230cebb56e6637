"""Places that fail a training: a shared folder that is slow, or gone for a while or for good, and a checkout and a home
that cannot be written to. docs/faults.md tells of these tests."""

from __future__ import annotations

import errno
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from checkout import ROOT
from process_tree import running
from test_progress import Timed
from test_training import Fake, rows, run
from told import told

from envs.errors import UserError
from envs.kernels.jit import cache_folder
from freemesh_ray.training import checkpoint, loop
from freemesh_ray.training.job import train
from freemesh_ray.training.status import Status


def at_steps(steps: int, act: Callable[[], Any]) -> Callable[[Status], None]:
    """A report that acts once."""

    def report(status: Status) -> None:
        if status.env_steps == steps:
            act()

    return report


def checkpoints(settings: dict[str, Any]) -> list[str]:
    """Their names, newest first; everything else in their folder is a fault."""
    folder = Path(settings["paths"]["runs"]) / "fake" / "checkpoints"
    found = [path.name for path in checkpoint.found(folder)]
    assert sorted(path.name for path in folder.iterdir()) == sorted(found)
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("steps", "failures"), [(300, 1), (400, 2), (1000, 0)])
def test_a_folder_that_is_away_for_a_while_costs_nothing(steps: int, failures: int, settings: dict[str, Any]) -> None:
    """Moved away an iteration before, and back one after: an evaluation, that and a checkpoint, the end."""
    runs = Path(settings["paths"]["runs"])
    away = runs.with_name("away")
    notes: list[str] = []

    def report(status: Status) -> None:
        if status.env_steps == steps - 100:
            runs.rename(away)
        if status.env_steps == steps + 100:
            away.rename(runs)

    if steps == 1000:
        with pytest.raises(UserError) as raised:
            run(settings, Fake(), callbacks=told(report=report, note=notes.append))
        assert "\n" not in str(raised.value)
        assert "no checkpoint at 1,000 steps (No such file or directory)" in str(raised.value)
        assert not runs.exists()
        away.rename(runs)
        assert run(settings, Fake(), resume=True).progress.env_steps == 1000
    else:
        assert run(settings, Fake(), callbacks=told(report=report, note=notes.append)).progress.env_steps == 1000
        assert len(notes) == failures
        assert all("No such file or directory); training goes on" in note for note in notes)
        assert all(note.startswith(str(runs)) for note in notes)
    assert [row["env_steps"] for row in rows(settings)] == [300, 600, 900, 1000]
    assert checkpoints(settings)[0] == "step_000001000"
    assert not away.exists()


def test_a_checkpoint_has_the_evaluations_before_it_that_could_not_be_written(settings: dict[str, Any]) -> None:
    runs = Path(settings["paths"]["runs"])
    away = runs.with_name("away")

    def report(status: Status) -> None:
        if status.env_steps == 200:
            runs.rename(away)
        if status.env_steps == 400:
            away.rename(runs)

    with pytest.raises(KeyboardInterrupt):
        run(settings, Fake(interrupt_at=500), callbacks=told(report=report))
    assert [row["env_steps"] for row in rows(settings)] == [300]
    assert (runs / "fake" / "policy.npz").is_file()
    assert checkpoints(settings) == ["step_000000400"]


@pytest.mark.slow
def test_a_checkpoint_makes_no_folder_where_a_shared_one_was(settings: dict[str, Any]) -> None:
    runs = Path(settings["paths"]["runs"])
    made: list[bool] = []
    notes: list[str] = []

    def report(status: Status) -> None:
        if status.env_steps == 400:
            runs.rename(runs.with_name("away"))
        if status.env_steps == 500:
            made.append(runs.exists())
            runs.with_name("away").rename(runs)

    assert run(settings, Fake(), callbacks=told(report=report, note=notes.append)).progress.env_steps == 1000
    assert made == [False]
    assert "no checkpoint at 400 steps" in notes[0]


@pytest.mark.slow
@pytest.mark.parametrize("tracked", [False, True])
def test_a_folder_that_is_removed_is_the_training_s_end_and_not_made_anew(
    tracked: bool, settings: dict[str, Any], tmp_path: Path
) -> None:
    """Where a mount is gone, what is written there would lie hidden below it when it is back."""
    settings["tracking"] |= {"enabled": tracked, "uri": f"sqlite:///{tmp_path / 'mlflow.db'}"}
    runs = Path(settings["paths"]["runs"])
    with pytest.raises(UserError) as raised:
        run(settings, Fake(), callbacks=told(report=at_steps(500, lambda: shutil.rmtree(runs))))
    assert "\n" not in str(raised.value)
    assert str(runs) in str(raised.value)
    assert not runs.exists()
    assert run(settings, Fake(), resume=True).progress.env_steps == 1000


@pytest.mark.slow
def test_a_failure_while_the_folder_is_gone_does_not_begin_anew_elsewhere(settings: dict[str, Any]) -> None:
    runs = Path(settings["paths"]["runs"])

    class Falls(Fake):
        def train(self) -> dict[str, Any]:
            if self.env_steps == 500:
                runs.rename(runs.with_name("away"))
                raise RuntimeError("the learner is gone")
            return super().train()

    with pytest.raises(UserError, match=r"fake: is out of reach \(No such file or directory\): .*--resume"):
        run(settings, Falls())
    assert not runs.exists()
    runs.with_name("away").rename(runs)
    assert checkpoints(settings) == ["step_000000400"]
    assert run(settings, Fake(), resume=True).progress.env_steps == 1000


@contextmanager
def unreachable(folder: Path, number: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Every call of the system's that names something below a folder fails."""

    def failing(call: Callable[..., Any]) -> Callable[..., Any]:
        def fails(path: Any, *given: Any, **named: Any) -> Any:
            if isinstance(path, str | bytes | os.PathLike) and str(folder) in os.fsdecode(path):
                raise OSError(number, os.strerror(number), os.fsdecode(path))
            return call(path, *given, **named)

        return fails

    with monkeypatch.context() as patch:
        for name in ("open", "stat", "lstat", "mkdir", "rename", "replace", "unlink", "rmdir", "scandir", "listdir"):
            patch.setattr(os, name, failing(getattr(os, name)))
        patch.setattr("io.open", failing(open))
        patch.setattr("builtins.open", failing(open))
        yield


@pytest.mark.slow
@pytest.mark.parametrize("number", [errno.ESTALE, errno.EIO])
@pytest.mark.parametrize("fails", [False, True])
def test_a_folder_that_cannot_be_reached_ends_in_one_line(
    fails: bool, number: int, settings: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the end of a training, and when it fails by something else at that moment."""
    runs = Path(settings["paths"]["runs"])
    reason = os.strerror(number)
    gone = unreachable(runs, number, monkeypatch)

    class Falls(Fake):
        def train(self) -> dict[str, Any]:
            if fails and self.env_steps == 600:
                raise RuntimeError("the learner is gone")
            return super().train()

    notes: list[str] = []
    try:
        with pytest.raises(UserError) as raised:
            run(settings, Falls(), callbacks=told(report=at_steps(500, gone.__enter__), note=notes.append))
    finally:
        gone.__exit__(None, None, None)
    assert "\n" not in str(raised.value)
    assert reason in str(raised.value)
    assert all("\n" not in note for note in notes)
    assert checkpoints(settings) == ["step_000000400"]
    assert run(settings, Fake(), resume=True).progress.env_steps == 1000
    assert [row["env_steps"] for row in rows(settings)] == [300, 600, 900, 1000]
    assert not list((runs / "fake").rglob(".damaged*"))


def test_a_slow_folder_costs_its_time_and_nothing_else(
    settings: dict[str, Any],
    clock: list[float],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Every file takes five seconds to be flushed: that is training's time, too."""
    flushed = []

    def slow(descriptor: int) -> None:
        clock[0] += 5.0
        flushed.append(descriptor)

    monkeypatch.setattr(os, "fsync", slow)
    statuses: list[Status] = []
    trained = train(settings, make=lambda _: Timed(clock), callbacks=told(report=statuses.append))
    assert trained.progress.env_steps == 1000
    assert len(flushed) >= 6
    assert trained.progress.seconds >= 40.0 + 5.0 * 4  # the last checkpoint's are not in it
    assert {status.updates_per_second for status in statuses} == {12.5}
    assert checkpoints(settings) == ["step_000001000", "step_000000800"]


@pytest.mark.slow
def test_a_line_cut_short_by_a_full_disk_does_not_take_the_next_with_it(
    settings: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    full, notes = [True], list[str]()

    class Half:
        """A file that takes half of what is written."""

        def __init__(self, file: Any) -> None:
            self.file = file

        def __enter__(self) -> Half:
            return self

        def __exit__(self, *error: object) -> None:
            self.file.close()

        def write(self, content: bytes) -> None:
            self.file.write(content[: len(content) // 2])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        def __getattr__(self, name: str) -> Any:
            return getattr(self.file, name)

    def opened(path: Any, mode: str = "r", **named: Any) -> Any:
        wrapped = Half if Path(path).name == "evaluations.jsonl" and full and full.pop() else lambda file: file
        return wrapped(open(path, mode, **named))

    monkeypatch.setattr(loop, "open", opened, raising=False)
    trained = run(settings, Fake(), callbacks=told(note=notes.append))
    assert "no evaluation written (No space left on device); training goes on" in notes[0]
    folder = trained.folder.path
    assert [row["env_steps"] for row in loop.RunFolder(folder).read_evaluations()] == [300, 600, 900, 1000]


@pytest.mark.slow
def test_a_checkout_and_a_home_that_cannot_be_written_to_are_enough(tmp_path: Path) -> None:
    """Machine code is kept among the temporary files; nothing else is missed. File modes bind this process as they bind
    any user: root's power over them is given up."""
    place = tmp_path / "checkout"
    for name in ("envs", "freemesh_ray", "tune_configs"):
        shutil.copytree(ROOT / name, place / name, ignore=shutil.ignore_patterns("__pycache__"))
    (place / "home").mkdir()
    for folder, _, files in os.walk(place):
        for name in files:
            os.chmod(Path(folder) / name, 0o444)
        os.chmod(folder, 0o555)
    temporary = Path(tempfile.mkdtemp(prefix="t", dir="/tmp"))
    kernels = temporary / f"freemesh-kernels-{os.getuid()}"
    kernels.mkdir(mode=0o700)
    for package in ("envs", "freemesh_ray"):
        kept = Path(cache_folder(ROOT / package))
        if kept.is_dir():
            shutil.copytree(kept, kernels / kept.name)
    script = (
        "import ctypes, os\n"
        "for power in (1, 2):\n"  # CAP_DAC_OVERRIDE, CAP_DAC_READ_SEARCH: also of what it starts
        "    ctypes.CDLL(None).prctl(24, power, 0, 0, 0)\n"
    )
    command = [
        "-m", "freemesh_ray", "train", "--config", "train_smoke.yaml", "--set", f"paths.runs={tmp_path / 'runs'}",
        "--set", "runners.count=0", "--set", "tracking.enabled=false", "--set", "budget.env_steps=1200",
        "--set", "name=there",
    ]  # fmt: skip
    script += f"os.execv({sys.executable!r}, {[sys.executable, *command]!r})\n"
    environment = {"PYTHONPATH": str(place), "HOME": str(place / "home"), "TMPDIR": str(temporary)}
    (tmp_path / "work").mkdir()
    try:
        with running(["-c", script], tmp_path / "work", environment | {"NUMBA_CACHE_DIR": ""}) as training:
            assert training.ended(300) == 0, training.output
            print(training.output)
            assert "Traceback" not in training.output
            assert "best policy from step " in training.output
        assert (tmp_path / "runs" / "there" / "policy.npz").is_file()
        assert not list(place.rglob("__pycache__"))
        assert not list((place / "home").iterdir())
    finally:
        subprocess.run(["chmod", "-R", "u+w", str(place)], check=True)
        shutil.rmtree(temporary, ignore_errors=True)
