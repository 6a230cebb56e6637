"""Processes of this machine, each of which does one job after another; one that dies costs its job alone."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from multiprocessing import connection
from multiprocessing.connection import Connection
from typing import Any

from freemesh_ray.batch.inputs import Job
from freemesh_ray.batch.outcome import Outcome
from freemesh_ray.storage.environment import variables_set

#: Seconds that processes get to end by themselves.
END_SECONDS = 0.5

#: What a process of many does with its cores: one thread each.
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")

Work = Callable[[Job], Outcome]


class Worker:
    """A process that does jobs, started with the first.

    Args:
        work: is pickled.
    """

    def __init__(self, work: Work) -> None:
        ours, its = multiprocessing.Pipe()
        context = multiprocessing.get_context("spawn")
        self.process: Any = context.Process(target=serve, args=(its, work), daemon=True)
        with variables_set(dict.fromkeys(THREADS, "1")):
            self.process.start()
        its.close()
        self.pipe = ours
        self.job: Job | None = None

    def begin(self, job: Job) -> None:
        """Hand it a job; one that is gone is noticed when its outcome is asked for."""
        self.job = job
        with suppress(OSError):
            self.pipe.send(job)

    def outcome(self) -> Outcome | None:
        """Of its job; None: it is gone."""
        try:
            outcome: Outcome = self.pipe.recv()
        except (EOFError, OSError):
            return None
        return outcome

    def how_it_ended(self) -> str:
        """``signal SIGKILL``, ``exit code 1``."""
        self.process.join(END_SECONDS)
        code = self.process.exitcode
        if code is not None and code < 0:
            return signal.Signals(-code).name
        return f"exit code {code}"


def done_here(jobs: Sequence[Job], work: Work, processes: int) -> Iterator[tuple[Job, Outcome]]:
    """Do jobs, so many at a time; each as it ends.

    When the iterator is closed, or an exception passes, the processes are ended within a second.
    """
    waiting, workers = list(reversed(jobs)), list[Worker]()
    try:
        for _ in range(min(processes, len(jobs))):
            workers.append(Worker(work))
            workers[-1].begin(waiting.pop())
        while busy := {worker.pipe: worker for worker in workers if worker.job is not None}:
            for pipe in connection.wait(list(busy)):
                worker = busy[pipe]  # type: ignore[index]
                job, worker.job, outcome = worker.job, None, worker.outcome()
                assert job is not None
                if outcome is None:
                    outcome = Outcome.died(job.source, worker.how_it_ended())
                    workers.remove(worker)
                    if waiting:
                        worker = Worker(work)
                        workers.append(worker)
                if waiting:
                    worker.begin(waiting.pop())
                yield job, outcome
    finally:
        end(workers)


def end(workers: Sequence[Worker]) -> None:
    """End processes: those that wait by themselves, the others by force."""
    for worker in workers:
        worker.pipe.close()
        if worker.job is not None:
            worker.process.terminate()
    for worker in workers:
        worker.process.join(END_SECONDS)
    for worker in workers:
        worker.process.kill()
        worker.process.join()


def serve(pipe: Connection, work: Work) -> None:
    """Do jobs until there is nobody any more who hands them out."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who started us, and ends us
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    while True:
        try:
            job: Job = pipe.recv()
            pipe.send(work(job))
        except (EOFError, OSError):
            return
