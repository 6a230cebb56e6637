"""All files of a batch: meshed, put in their place, told."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import TextIO

from freemesh_ray.batch.inputs import Job, meshed_before
from freemesh_ray.batch.outcome import Outcome
from freemesh_ray.batch.outputs import draft_of, put
from freemesh_ray.batch.progress import Progress
from freemesh_ray.storage.atomic import OutputError

#: Does jobs: each with what became of it, as it ends.
Doing = Callable[[Sequence[Job]], Iterator[tuple[Job, Outcome]]]


def whole_batch(
    jobs: Sequence[Job],
    doing: Doing,
    folder: Path,
    drafts: Path,
    formats: Sequence[str],
    stream: TextIO,
    *,
    split: bool = False,
    resume: bool = False,
    keep_going: bool = False,
    rows: list[tuple[Job, Outcome]] | None = None,
) -> list[tuple[Job, Outcome]]:
    """Do all jobs, and put what each has made into the folder at once.

    Args:
        jobs: see `inputs.jobs_of`.
        doing: does them.
        folder: where to put meshes.
        drafts: where jobs write, in the folder `outputs.draft_of` says.
        formats: suffixes of what each writes.
        stream: for progress.
        split: whether a file may have several meshes.
        resume: leave out what was meshed before.
        keep_going: do not end with the first file that fails.
        rows: filled as files end, for who is interrupted.

    Returns:
        The jobs that ended, and what became of them.
    """
    rows = [] if rows is None else rows
    progress = Progress(len(jobs), stream)
    progress.begin()
    left = []
    try:
        for job in jobs:
            if resume and meshed_before(job, folder, formats, split=split):
                rows.append((job, Outcome(skipped=True)))
                progress.tell(*rows[-1])
            else:
                left.append(job)
        with closing(doing(left)) as ended:  # type: ignore[type-var]
            for job, outcome in ended:
                if outcome.meshes:
                    try:
                        put(draft_of(job, drafts), outcome.files, folder)
                    except OutputError as error:
                        outcome.error, outcome.code = str(error), error.exit_code
                rows.append((job, outcome))
                progress.tell(job, outcome)
                if outcome.error and not keep_going:
                    break
    finally:
        progress.clear()
    return rows
