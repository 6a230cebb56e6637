"""Clocks that jump: the machine's is set back and forth, and a machine, or the training's process, sleeps for an hour.

docs/faults.md tells of these tests.
"""

from __future__ import annotations

import io
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from test_progress import Timed
from test_training import Fake, rows
from told import told

from freemesh_ray.algorithms import awake, runner_calls
from freemesh_ray.algorithms.runner_calls import RunnerCalls
from freemesh_ray.storage.lock import InUseError, held
from freemesh_ray.storage.owner import Owner
from freemesh_ray.tracking import journal
from freemesh_ray.tracking.journal import Journal, State, latest
from freemesh_ray.tracking.killed_runs import fail_killed_runs
from freemesh_ray.training import checkpoint
from freemesh_ray.training.job import train
from freemesh_ray.training.progress_line import ProgressLine
from freemesh_ray.training.status import Status

HOUR, DAY = 3600.0, 86_400.0


class Interrupted(Timed):
    """What happens at some env steps; an iteration takes four seconds."""

    def __init__(self, clock: list[float], happens: dict[int, Callable[[], None]]) -> None:
        super().__init__(clock)
        self.happens = happens

    def train(self) -> dict[str, Any]:
        self.happens.get(self.env_steps, lambda: None)()
        return super().train()


@pytest.mark.slow
@pytest.mark.parametrize("between", [True, False])
@pytest.mark.parametrize("minutes", [None, 0.6])
def test_an_hour_asleep_is_no_hour_of_training(
    minutes: float | None,
    between: bool,
    settings: dict[str, Any],
    clock: list[float],
) -> None:
    settings["budget"]["minutes"] = minutes
    statuses: list[Status] = []

    def sleep() -> None:
        clock[0] += HOUR

    def report(status: Status) -> None:
        statuses.append(status)
        if between and status.env_steps == 500:
            sleep()

    fake = Interrupted(clock, {} if between else {500: sleep})
    trained = train(settings, make=lambda _: fake, callbacks=told(report=report))
    # The look that ends an hour's gap may leave out an iteration's four seconds with it.
    assert trained.progress.env_steps == 1000 if minutes is None else 900 <= trained.progress.env_steps <= 1000
    assert trained.progress.seconds == pytest.approx(trained.progress.env_steps / 25, abs=4.001)
    assert all(0 <= status.seconds_left <= 60 for status in statuses)
    assert all(status.updates_per_second > 0 for status in statuses)
    stream = io.StringIO()
    for status in statuses:
        ProgressLine(stream).on_iteration(status)
    assert "0:00:" not in stream.getvalue()
    assert checkpoint.read(trained.checkpoint)[1]["seconds"] < 60


@pytest.mark.slow
def test_an_iteration_in_which_the_clock_stands_still_has_a_rate(settings: dict[str, Any], clock: list[float]) -> None:
    assert train(settings, make=lambda _: Fake()).progress.env_steps == 1000


def test_only_a_process_that_could_do_nothing_was_asleep(clock: list[float], monkeypatch: pytest.MonkeyPatch) -> None:
    looks = awake._Clock()
    monkeypatch.setattr(awake, "LOOK_SECONDS", 0.0)
    first, _ = looks.look()
    looked = threading.Event()
    look = looks.look

    def seen() -> tuple[float, float]:
        looked.set()
        return look()

    monkeypatch.setattr(looks, "look", seen)
    for _ in range(20):  # busy for long, while the thread looks
        clock[0] += 20.0
        looked.clear()
        assert looked.wait(30)
        looked.clear()
        assert looked.wait(30)
    assert look() == (pytest.approx(first + 400.0), 0.0)
    clock[0] += HOUR
    assert look() == (pytest.approx(first + 400.0), HOUR)


class Slept:
    """Two env runners, the second of which has not answered when the time was up, and the Ray that asks them."""

    class Runner:
        def __init__(self, number: int) -> None:
            self.collect = self
            self.number = number

        def remote(self, **request: Any) -> int:
            return self.number

    def __init__(self, clock: list[float], seconds: float) -> None:
        self.clock, self.seconds, self.marked, self.killed = clock, seconds, list[int](), list[int]()

    def healthy_actor_ids(self) -> list[int]:
        return [1, 2]

    def actors(self) -> dict[int, Runner]:
        return {number: self.Runner(number) for number in (1, 2)}

    def set_actor_state(self, runner: int, healthy: bool) -> None:
        self.marked.append(runner)

    def get(self, answer: int) -> str:
        return "transitions"

    def kill(self, actor: Runner, no_restart: bool) -> None:
        self.killed.append(actor.number)

    def wait(self, asked: list[int], **named: Any) -> tuple[list[int], list[int]]:
        for _ in range(int(self.seconds // 20)):
            self.clock[0] += 20.0
            awake.awake()  # as the thread does
        self.clock[0] += self.seconds % 20 if self.seconds < HOUR else HOUR
        return [1], [one for one in asked if one != 1]


@pytest.mark.parametrize(("seconds", "hung"), [(300.0, [2]), (HOUR, [])])
def test_an_env_runner_is_not_taken_for_hung_when_all_were_asleep(
    seconds: float,
    hung: list[int],
    clock: list[float],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    both = Slept(clock, seconds)
    monkeypatch.setattr(runner_calls, "ray", both)
    calls = RunnerCalls(both, 300.0)
    calls.ask("collect", {})
    found = calls.answers()
    assert found[1] == "transitions"
    assert (both.marked, both.killed, set(found)) == (hung, hung, {1, *hung})
    assert len(calls) == 1 - len(hung)  # what one that was asleep has been asked for comes later


@pytest.fixture
def wall_clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Seconds by which the machine's clock is off, which a test may change."""
    off, real = [0.0], time.time
    monkeypatch.setattr(time, "time", lambda: real() + off[0])

    class Told(datetime):
        @classmethod
        def now(cls, zone: Any = None) -> datetime:
            return datetime.fromtimestamp(time.time(), zone)

    monkeypatch.setattr(journal, "datetime", Told)
    return off


@pytest.mark.slow
def test_the_machine_s_clock_set_back_and_forth_changes_nothing(
    settings: dict[str, Any], wall_clock: list[float], tmp_path: Path
) -> None:
    statuses: list[Status] = []

    def jump(status: Status) -> None:
        statuses.append(status)
        wall_clock[0] = DAY * (-1) ** (status.env_steps // 100)

    settings["tracking"] |= {"enabled": True, "uri": f"sqlite:///{tmp_path / 'mlflow.db'}"}
    statuses: list[Status] = []
    began = time.monotonic()
    trained = train(
        settings, make=lambda _: Fake(), callbacks=told(report=lambda status: (jump(status), statuses.append(status)))
    )
    took = time.monotonic() - began
    assert [row["env_steps"] for row in rows(settings)] == [300, 600, 900, 1000]
    assert 0 < trained.progress.seconds < took
    assert all(0 <= status.seconds_left <= 10 * took for status in statuses)

    from freemesh_ray.tracking.mlflow_store import connect

    client = connect(settings["tracking"]["uri"])
    (run,) = client.search_runs([client.get_experiment_by_name(settings["tracking"]["experiment"]).experiment_id])
    assert run.info.status == "FINISHED"
    steps = [one.step for one in client.get_metric_history(run.info.run_id, "train/updates")]
    assert sorted(steps) == list(range(100, 1001, 100))

    # A run that is at work is not taken for killed, whatever its start says.
    client.update_run(run.info.run_id, status="RUNNING")
    for off in (-DAY, DAY):
        wall_clock[0] = off
        arguments = settings["tracking"]["uri"], settings["tracking"]["experiment"], ""
        fail_killed_runs(*arguments, [tmp_path / "none"], time.monotonic() + 10)
        assert client.get_run(run.info.run_id).info.status == "RUNNING"


def test_the_newest_journal_is_the_one_that_was_begun_last(wall_clock: list[float], tmp_path: Path) -> None:
    for off in (DAY, 0.0, -DAY, -DAY):
        wall_clock[0] = off
        made = Journal.new(tmp_path, State("sqlite:///a.db", "experiment"))
        made.release()
        found = latest(tmp_path)
        assert found is not None
        assert found.id == made.id
        found.release()
    (tmp_path / "tracking" / "99991231T235959-00000000.jsonl").touch()  # none can come after it
    Journal.new(tmp_path, State("sqlite:///a.db", "experiment")).release()


def test_a_lock_does_not_end_with_the_clock(wall_clock: list[float], tmp_path: Path) -> None:
    with held(tmp_path, "wait"):
        for wall_clock[0] in (-DAY, DAY):
            with pytest.raises(InUseError), held(tmp_path, "wait", patience=0.1):
                pass


def test_this_process_is_not_gone_whatever_the_clock_says() -> None:
    here = Owner.here()
    for at in (0.0, datetime.now(UTC).timestamp() - DAY, datetime.now(UTC).timestamp() + DAY):
        assert not here.is_gone(here, at)
