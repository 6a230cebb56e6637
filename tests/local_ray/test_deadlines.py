"""How long what watches others waits: a command works again within 15 s of a fault, or ends with a line within 10 s.

Tests that kill and stop real processes (test_deaths.py, tests/training/test_processes.py and
tests/serving/test_killed_processes.py) take longer on a busy machine, and allow for that. What is configured is told
here. Each fault is found by a look, waited for, and then what it took away is started anew, or all is ended.
"""

from __future__ import annotations

from freemesh_ray.local_ray import guard, session
from freemesh_ray.serving import awake, http_process, pool, service, session_processes, supervisor
from freemesh_ray.studies import runner
from freemesh_ray.training import stop_signal

#: Seconds until it works again, and until it has ended.
AGAIN, ENDED = 15.0, 10.0

#: Seconds that a mesher takes to start, and of the end of Ray and of what is left of it, on a machine with nothing else
#: to do; docs/faults.md has what was measured.
START, END = 4.5, 0.5


def test_stopped_processes_are_let_go_on_soon() -> None:
    by_the_guard = guard.STOPPED_LOOKS * guard.LOOK_SECONDS
    the_guard_itself = session.LOOK_SECONDS
    by_the_command = service.LOOK
    the_command_itself = http_process.LOOK
    assert by_the_guard + the_guard_itself + by_the_command + the_command_itself < 0.5 * AGAIN


def test_a_mesher_that_is_silent_is_replaced_in_time() -> None:
    assert pool.SILENT + pool.ASKED + START <= AGAIN
    assert pool.HOLDS < pool.SILENT  # nobody is told meanwhile that it could mesh


def test_a_service_that_is_silent_ends_in_time() -> None:
    assert service.SILENT + service.LOOK + END <= ENDED
    # A gap in which the command itself could not look counts for less than its patience.
    assert service.LOOK <= awake.MOST < service.SILENT


def test_a_signal_ends_a_command_in_time() -> None:
    assert stop_signal.URGENT_SECONDS < stop_signal.LAST_SECONDS <= ENDED - END
    assert runner.PEACE_SECONDS < stop_signal.LAST_SECONDS
    assert http_process.GRACE < service.ENDING
    assert service.ENDING + session_processes.GUARD <= ENDED
    assert session.GUARD_SECONDS <= ENDED


def test_a_worker_is_given_up_before_its_mesher_is() -> None:
    assert supervisor.SLACK < pool.SLACK
