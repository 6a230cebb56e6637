"""Callbacks of a training: what they are told and when, how they end it early, and what one that fails costs."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from test_training import Factory, Fake, rows, run

from envs.errors import BAD_INPUT, PluginError
from freemesh_ray.policies.policy import Policy
from freemesh_ray.training import checkpoint
from freemesh_ray.training.callback import Callback, StopTraining
from freemesh_ray.training.job import train
from freemesh_ray.training.run_folder import RunFolder
from freemesh_ray.training.stop_signal import StopSignal

#: Hook -> env steps at which the fake training calls it first.
FIRST = {"on_start": 0, "on_iteration": 100, "on_evaluation": 300, "on_checkpoint": 400, "on_end": 1000}


class Recorder(Callback):
    """Appends (its name, hook, what it was told) to a list."""

    def __init__(self, name: str, told: list[tuple[str, str, Any]]) -> None:
        def recording(hook: str) -> Callable[[Any], None]:
            return lambda what: told.append((name, hook, what))

        for hook in (*FIRST, "on_note"):
            setattr(self, hook, recording(hook))


class Acts(Callback):
    """Does something when ``hook`` is called first."""

    def __init__(self, hook: str, act: Callable[[], None]) -> None:
        acts = iter([act])
        setattr(self, hook, lambda what: next(acts, lambda: None)())


def raising(error: BaseException) -> Callable[[], None]:
    def act() -> None:
        raise error

    return act


def folder(settings: dict[str, Any]) -> RunFolder:
    return RunFolder(Path(settings["paths"]["runs"]) / "fake")


def checkpoints(settings: dict[str, Any]) -> list[str]:
    return [path.name for path in checkpoint.found(folder(settings).checkpoints)]


@pytest.mark.slow
def test_they_are_told_in_order_and_of_the_same(settings: dict[str, Any]) -> None:
    told: list[tuple[str, str, Any]] = []
    result = run(settings, Fake(), callbacks=[Recorder("a", told), Recorder("b", told)])
    first, second = told[::2], told[1::2]
    assert [entry[1:] for entry in first] == [entry[1:] for entry in second]
    assert {name for name, _, _ in first} == {"a"}
    assert [hook for _, hook, _ in first if hook != "on_iteration"] == [
        "on_start", "on_evaluation", "on_checkpoint", "on_evaluation", "on_checkpoint", "on_evaluation",
        "on_evaluation", "on_checkpoint", "on_end",
    ]  # fmt: skip
    of = {hook: [what for _, each, what in first if each == hook] for hook in FIRST}
    assert [status.env_steps for status in of["on_iteration"]] == list(range(100, 1001, 100))
    assert of["on_evaluation"] == rows(settings) == result.evaluations
    assert [path.name for path in of["on_checkpoint"]] == ["step_000000400", "step_000000800", "step_000001000"]
    assert of["on_start"][0].config == settings
    assert of["on_end"] == [result]


def check_whole(result: Any, env_steps: int) -> None:
    """A result as that of every training that came to its end."""
    assert result.progress.env_steps == env_steps
    assert result.evaluations[-1]["env_steps"] == env_steps
    assert result.checkpoint.name == f"step_{env_steps:09d}"
    assert Policy.load(result.folder.policy).about == result.policy.about
    assert result.folder.curve.is_file()
    assert [stage.domain for stage in result.stages] == ["T1"]


@pytest.mark.slow
@pytest.mark.parametrize("hook", FIRST)
def test_one_that_stops_the_training_leaves_all_that_its_budget_s_end_leaves(
    hook: str, settings: dict[str, Any]
) -> None:
    told: list[tuple[str, str, Any]] = []
    callbacks = [Acts(hook, raising(StopTraining())), Recorder("after", told)]
    result = run(settings, Fake(), callbacks=callbacks)
    check_whole(result, FIRST[hook])
    assert told[-1] == ("after", "on_end", result)
    assert {hook for _, hook, _ in told} >= {"on_start", "on_evaluation", "on_checkpoint", "on_end"}
    check_whole(run(settings, Fake(), resume=True), 1000)


@pytest.mark.slow
@pytest.mark.parametrize("error", [ValueError("no such\nthing"), SystemExit(3)], ids=["error", "exit"])
@pytest.mark.parametrize("hook", FIRST)
def test_one_that_fails_is_named_and_costs_nothing(hook: str, error: BaseException, settings: dict[str, Any]) -> None:
    factory, told = Factory(), list[tuple[str, str, Any]]()
    callbacks = [Acts(hook, raising(error)), Recorder("after", told)]
    with pytest.raises(PluginError) as raised:
        train(settings, make=factory, callbacks=callbacks)
    line = str(raised.value)
    assert raised.value.exit_code == BAD_INPUT
    assert "\n" not in line
    for word in ("Acts", hook, type(error).__name__, str(error).splitlines()[0]):
        assert word in line
    assert raised.value.__cause__ is error
    assert "raise error" in folder(settings).failures.read_text()
    assert len(factory.made) == 1, "it is not tried again"
    assert hook not in [told_hook for _, told_hook, _ in told], "nothing is told after that"
    steps = FIRST[hook]
    assert checkpoints(settings)[:1] == ([f"step_{steps:09d}"] if steps else [])
    check_whole(run(settings, Fake(), resume=True), 1000)
    assert [row["env_steps"] for row in rows(settings)] == [300, 600, 900, 1000]


def test_an_object_of_another_class_is_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(PluginError, match=r"print.*freemesh_ray\.Callback"):
        run(settings, Fake(), callbacks=[print])
    assert not folder(settings).path.exists()


@pytest.mark.slow
@pytest.mark.parametrize("hook", [hook for hook in FIRST if hook != "on_end"])
def test_ctrl_c_in_one_saves_a_checkpoint(hook: str, settings: dict[str, Any]) -> None:
    with pytest.raises(KeyboardInterrupt):
        run(settings, Fake(), callbacks=[Acts(hook, raising(KeyboardInterrupt()))])
    assert checkpoints(settings) == [f"step_{max(100, FIRST[hook]):09d}"]
    check_whole(run(settings, Fake(), resume=True), 1000)


@pytest.mark.slow
def test_a_second_signal_ends_one_that_hangs(settings: dict[str, Any]) -> None:
    """`freemesh_ray.train` gives it after a while."""

    def hang() -> None:
        signal.raise_signal(signal.SIGINT)
        threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT)).start()
        threading.Event().wait(60)
        raise AssertionError("it was not interrupted")

    with pytest.raises(KeyboardInterrupt), StopSignal(lambda: None) as stop:
        run(settings, Fake(), callbacks=[Acts("on_iteration", hang)], interrupted=stop.was_given)
    assert checkpoints(settings) == ["step_000000100"]
    check_whole(run(settings, Fake(), resume=True), 1000)
