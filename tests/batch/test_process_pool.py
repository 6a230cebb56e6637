"""Jobs in processes: each in one of its own, one that dies costs its job alone, and closing ends them at once."""

from __future__ import annotations

import os
import signal
import time

from freemesh_ray.batch.inputs import Job
from freemesh_ray.batch.outcome import Outcome
from freemesh_ray.batch.process_pool import done_here


def jobs(*sources: str) -> list[Job]:
    return [Job(i, source, source) for i, source in enumerate(sources)]


def work(job: Job) -> Outcome:
    if job.source == "dies":
        os.kill(os.getpid(), signal.SIGKILL)
    if job.source == "leaves":
        os._exit(3)
    if job.source == "sleeps":
        time.sleep(600)
    return Outcome(notes=[str(os.getpid()), os.environ["OMP_NUM_THREADS"]])


def test_every_job_is_done_once_elsewhere_with_one_thread() -> None:
    done = dict(done_here(jobs(*"abcdef"), work, 2))
    assert sorted(job.source for job in done) == list("abcdef")
    assert {outcome.notes[1] for outcome in done.values()} == {"1"}
    ran = {outcome.notes[0] for outcome in done.values()}
    assert 1 <= len(ran) <= 2
    assert str(os.getpid()) not in ran


def test_a_process_that_dies_costs_its_job_alone() -> None:
    done = {job.source: outcome for job, outcome in done_here(jobs("a", "dies", "b", "leaves", "c"), work, 1)}
    assert {source for source, outcome in done.items() if outcome.error} == {"dies", "leaves"}
    assert done["dies"].error.startswith("dies: its process died (SIGKILL)")
    assert "exit code 3" in done["leaves"].error
    assert done["dies"].code == 1


def test_closing_ends_the_processes_within_seconds() -> None:
    doing = done_here(jobs("a", "sleeps", "sleeps"), work, 2)
    next(doing)
    began = time.monotonic()
    doing.close()
    assert time.monotonic() - began < 60.0  # of 600


def test_no_jobs_start_no_process() -> None:
    assert list(done_here([], work, 4)) == []
