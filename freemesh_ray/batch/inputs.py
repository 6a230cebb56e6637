"""The files of a batch, and what each one's meshes are called."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from freemesh_ray.storage.atomic import OutputError


@dataclass(frozen=True)
class Job:
    """One file.

    Attributes:
        number: its place among the inputs.
        source: as it was given.
        stem: of the files that are written.
    """

    number: int
    source: str
    stem: str


def jobs_of(sources: Sequence[str], *, split: bool) -> list[Job]:
    """The jobs, if no two write a file of one name.

    Args:
        sources: files, or names of domains.
        split: a file ``part`` may become ``part-0``, ``part-1``, ...

    Raises:
        OutputError: two do, with both names.
    """
    jobs = [Job(i, source, Path(source).stem) for i, source in enumerate(sources)]
    taken: dict[str, Job] = {}
    for job in jobs:
        other = taken.setdefault(job.stem.lower(), job)
        if other is not job:
            raise clash(other, job)
    for job in jobs if split else []:
        numbered = re.fullmatch(r"(.+)-\d+", job.stem.lower())
        if numbered and numbered[1] in taken:
            raise clash(taken[numbered[1]], job)
    return jobs


def clash(first: Job, second: Job) -> OutputError:
    """The error of two inputs whose outputs would have one name."""
    return OutputError(
        f"{first.source} and {second.source}: their meshes would have one name; rename one, or use two folders"
    )


def meshed_before(job: Job, folder: Path, formats: Sequence[str], *, split: bool) -> bool:
    """Whether meshes of all formats are in the folder, none older than the input.

    A file's meshes are put there together, when all are made, so that one of each format stands for all.
    """
    try:
        given = Path(job.source).stat().st_mtime
    except OSError:
        given = 0.0  # a name of the catalogue
    for suffix in formats:
        plain = folder / f"{job.stem}{suffix}"
        found = [plain] if plain.exists() else []
        if split:
            name = re.compile(re.escape(job.stem) + r"-\d+" + re.escape(suffix))
            found += [path for path in folder.glob(f"*{suffix}") if name.fullmatch(path.name)]
        if not found or min(path.stat().st_mtime for path in found) < given:
            return False
    return True
