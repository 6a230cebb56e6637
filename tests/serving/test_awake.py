"""A machine that sleeps, or a service whose processes are all stopped for a while: no deadline is passed by that."""

from __future__ import annotations

import asyncio
import signal
import time
from typing import Any

import pytest
import ray

from freemesh_ray.serving import awake, pool, service, supervisor
from freemesh_ray.serving.answer import Answer, MeshRequest
from freemesh_ray.serving.awake import MOST, Awake, awake_timeout
from freemesh_ray.serving.lanes import COSTLY
from freemesh_ray.serving.limits import Limits
from freemesh_ray.serving.order import ServiceEnded
from freemesh_ray.serving.parameters import Parameters

HOUR = 3600.0


class Clock:
    """The clock of `awake`, which a test sets forth."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    one = Clock()
    monkeypatch.setattr(awake, "time", one)
    return one


def test_a_gap_between_two_looks_is_sleep(clock: Clock) -> None:
    seen = Awake()
    for _ in range(10):
        clock.now += 1.0
        assert seen.seconds() == clock.now - 100.0
    assert seen.asleep == 0.0
    clock.now += HOUR
    assert (seen.seconds(), seen.asleep) == (10.0 + MOST, HOUR - MOST)
    seen.restart()
    assert (seen.seconds(), seen.asleep) == (0.0, 0.0)


def test_a_deadline_outlives_a_sleep(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(awake, "LOOK", 0.01)

    async def waits(gaps: list[float]) -> None:
        async with awake_timeout(8.0):
            for gap in gaps:
                clock.now += gap
                await asyncio.sleep(0.05)

    asyncio.run(waits([HOUR, 2.0]))
    with pytest.raises(TimeoutError):
        asyncio.run(waits([2.0] * 10))


class Silent:
    """A connection from which nothing comes, and what happens while it is looked at."""

    def __init__(self, clock: Clock, gaps: list[float]) -> None:
        self.clock, self.gaps = clock, gaps

    def poll(self, seconds: float) -> bool:
        if not self.gaps:
            raise InterruptedError
        self.clock.now += self.gaps.pop(0)
        return False


@pytest.mark.parametrize(("gaps", "ends"), [([1.0, HOUR, 1.0], False), ([1.0] * 9, True)])
def test_the_command_does_not_end_a_service_that_slept(
    gaps: list[float], ends: bool, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    one: Any = object.__new__(service.Service)
    one._connection, one._process = Silent(clock, gaps), type("", (), {"pid": 2**22 + 1})
    monkeypatch.setattr(service.Service, "_kill", lambda self: None)
    with pytest.raises(ServiceEnded if ends else InterruptedError):
        one.wait()


def test_a_service_without_a_mesher_for_an_hour_of_sleep_goes_on(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ray, "put", lambda value: value)
    monkeypatch.setattr(ray, "remote", lambda **_: lambda kind: kind)
    meshers = pool.MesherPool({}, Limits(), 1)
    clock.now += HOUR
    assert meshers.seconds_without() == MOST
    for _ in range(60):
        clock.now += 0.5
        meshers.seconds_without()
    assert meshers.seconds_without() == MOST + 30.0


def test_a_mesh_is_made_again_whose_worker_s_alarm_went_on(clock: Clock) -> None:
    """As the kernel does: the worker's time is up when it is let go on."""

    class Slept(supervisor.Supervisor):
        asked = 0

        def start(self) -> None:
            self._connection = self  # type: ignore[assignment]

        def _newest(self) -> None:
            pass

        def send(self, request: MeshRequest) -> None:
            self.asked += 1

        def poll(self, seconds: float) -> bool:
            if self.asked == 1:
                clock.now += HOUR
                raise EOFError
            return True

        def recv(self) -> Answer:
            return Answer(200, b"")

        def _next(self) -> None:
            self._last_status = -signal.SIGALRM

    one = Slept({}, Limits(), COSTLY)
    answer = one.answer(MeshRequest(b"", Parameters("even")))
    assert answer is not None
    assert (answer.status, one.asked) == (200, 2)


def test_the_clock_is_one_that_nobody_can_set(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = Awake()
    monkeypatch.setattr(time, "time", lambda: -1e9)
    assert 0.0 <= seen.seconds() < 60.0
