"""A signal to a command that has something to save: remembered, urgent after a while, and obeyed whatever it does."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator

import pytest

from freemesh_ray.cli.command import main
from freemesh_ray.training import stop_signal
from freemesh_ray.training.stop_signal import StopSignal

NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@pytest.fixture(params=NUMBERS)
def number(request: pytest.FixtureRequest) -> Iterator[signal.Signals]:
    own = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the tests may run below nohup
    before = [signal.getsignal(each) for each in NUMBERS]
    yield request.param
    assert [signal.getsignal(each) for each in NUMBERS] == before
    signal.signal(signal.SIGHUP, own)


def test_what_nohup_has_the_process_ignore_is_ignored() -> None:
    own = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with StopSignal(lambda: None) as stop:
        signal.raise_signal(signal.SIGHUP)
        assert not stop.was_given()
    signal.signal(signal.SIGHUP, own)


def test_the_first_is_remembered_and_the_second_interrupts(number: signal.Signals) -> None:
    with pytest.raises(KeyboardInterrupt), StopSignal(lambda: None) as stop:  # noqa: PT012
        assert not stop.was_given()
        assert not stop.is_urgent()
        signal.raise_signal(number)
        assert stop.was_given()
        signal.raise_signal(number)


def test_it_becomes_urgent(number: signal.Signals, monkeypatch: pytest.MonkeyPatch) -> None:
    with StopSignal(lambda: None) as stop:
        signal.raise_signal(number)
        assert not stop.is_urgent()
        monkeypatch.setattr(stop_signal, "URGENT_SECONDS", -1.0)
        assert stop.is_urgent()


def test_who_does_not_ask_is_ended(number: signal.Signals, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stop_signal, "LAST_SECONDS", 0.05)
    ended = threading.Event()
    with StopSignal(ended.set):
        signal.raise_signal(number)
        assert ended.wait(30)


def test_who_asks_has_time_to_save_but_not_to_stay(number: signal.Signals, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stop_signal, "LAST_SECONDS", 0.05)
    ended = threading.Event()
    with StopSignal(ended.set) as stop:
        signal.raise_signal(number)
        assert stop.was_given()
        assert not ended.wait(0.3)
    assert ended.wait(30)


def test_a_signal_ends_every_command_as_ctrl_c_does(
    number: signal.Signals, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("freemesh_ray.cli.domains.run", lambda options: os.kill(os.getpid(), number))
    assert main(["domains"]) == 130
    assert capsys.readouterr().err == "freemesh: interrupted\n"
