"""Jobs as tasks of a Ray cluster: what a job reads goes there with it, and what it writes comes back."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from freemesh_ray.batch.inputs import Job
from freemesh_ray.batch.outcome import Outcome
from freemesh_ray.local_ray import local_ray
from freemesh_ray.storage.atomic import replacing

#: Tasks that wait at the cluster for one that runs: a cluster may grow.
AHEAD = 4

#: What a task calls: a job, the folder with its files, and the folder to write to.
Remote = Callable[[Job, Path, Path], Outcome]


def done_there(
    jobs: Sequence[Job], work: Remote, files: Callable[[Job], Mapping[str, bytes]]
) -> Iterator[tuple[Job, Outcome]]:
    """Do jobs on the cluster that RAY_ADDRESS names, a core each; each as it ends, its files in its outcome.

    Args:
        jobs: as said.
        work: called on a node, which has this package installed.
        files: the contents of what a job reads, by where they lie in the folder that it is given: ``domain/part.dxf``.
    """
    with local_ray(1):
        import ray

        task = ray.remote(num_cpus=1, max_retries=1)(in_a_folder)
        cores = int(ray.cluster_resources().get("CPU", 1))
        waiting, running = list(reversed(jobs)), dict[Any, Job]()
        try:
            while waiting or running:
                while waiting and len(running) < AHEAD * cores:
                    job = waiting.pop()
                    running[task.remote(job, work, files(job))] = job
                for done in ray.wait(list(running), num_returns=1)[0]:
                    job = running.pop(done)
                    try:
                        outcome = ray.get(done)
                    except ray.exceptions.RayError as error:
                        outcome = Outcome.died(job.source, str(error).strip().splitlines()[0])
                    yield job, outcome
        finally:
            for left in running:
                ray.cancel(left, force=True)


def in_a_folder(job: Job, work: Remote, files: Mapping[str, bytes]) -> Outcome:
    """Do a job in a folder of its own, and bring what it writes."""
    with tempfile.TemporaryDirectory() as made:
        given, written = Path(made) / "in", Path(made) / "out"
        given.mkdir()
        written.mkdir()
        for name, content in files.items():
            (given / name).parent.mkdir(exist_ok=True)
            with replacing(given / name) as draft:
                draft.write_bytes(content)
        outcome = work(job, given, written)
        outcome.files = {path.name: path.read_bytes() for path in sorted(written.iterdir()) if path.is_file()}
        return outcome
