"""A study that Ray Tune runs is ended by signals: Tune first, by its own signal, and then whatever runs."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator

import pytest

from freemesh_ray.studies import runner
from freemesh_ray.studies.runner import ended_by_signals

#: Seconds of a wait that a signal is to end.
LONG = 300.0


def signalled(*numbers: int) -> None:
    """A long wait amid which the signals come."""
    for number in numbers:
        os.kill(os.getpid(), number)
    threading.Event().wait(LONG)
    pytest.fail("nobody interrupted it")


@pytest.fixture
def obeyed() -> Iterator[list[int]]:
    """The signals that Tune gets."""
    told: list[int] = []
    before = signal.signal(signal.SIGUSR1, lambda number, frame: told.append(number))
    yield told
    signal.signal(signal.SIGUSR1, before)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_tune_is_told_and_what_still_runs_is_interrupted(
    number: int, obeyed: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runner, "PEACE_SECONDS", 0.05)
    before = signal.signal(number, signal.default_int_handler)  # whatever started the tests
    try:
        with pytest.raises(KeyboardInterrupt), ended_by_signals():
            signalled(number)
        assert signal.getsignal(number) is signal.default_int_handler
    finally:
        signal.signal(number, before)
    assert obeyed == [signal.SIGUSR1]


def test_a_study_that_nohup_began_outlives_its_terminal(obeyed: list[int]) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with ended_by_signals():
            os.kill(os.getpid(), signal.SIGHUP)
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
    assert obeyed == []


def test_the_second_signal_waits_for_nothing(obeyed: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "PEACE_SECONDS", LONG)
    with pytest.raises(KeyboardInterrupt), ended_by_signals():
        signalled(signal.SIGTERM, signal.SIGTERM)
    assert obeyed == [signal.SIGUSR1]


def test_a_study_that_ends_in_time_is_left_alone(obeyed: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "PEACE_SECONDS", LONG)
    before = signal.getsignal(signal.SIGTERM)
    with ended_by_signals():
        os.kill(os.getpid(), signal.SIGTERM)
    assert obeyed == [signal.SIGUSR1]
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.slow
def test_an_interruption_that_is_lost_is_repeated(obeyed: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "PEACE_SECONDS", 0.05)
    lost = []

    def loses_one() -> None:
        os.kill(os.getpid(), signal.SIGTERM)
        try:
            threading.Event().wait(LONG)
        except KeyboardInterrupt as interrupt:
            lost.append(interrupt)
        threading.Event().wait(LONG)
        pytest.fail("nobody interrupted it again")

    with pytest.raises(KeyboardInterrupt), ended_by_signals():
        loses_one()
    assert len(lost) == 1


def test_it_touches_no_signal_outside_the_main_thread() -> None:
    before, seen = signal.getsignal(signal.SIGTERM), []

    def inside() -> None:
        with ended_by_signals():
            seen.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=inside)
    thread.start()
    thread.join()
    assert seen == [before]
