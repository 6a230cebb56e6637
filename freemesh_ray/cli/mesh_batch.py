"""``freemesh mesh A.dxf B.dxf ... --out FOLDER``: many files in, a folder of meshes out."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import redirect_stderr
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Any

from envs.errors import FAILED, UserError
from freemesh_ray.batch.inputs import Job, jobs_of
from freemesh_ray.batch.outcome import Outcome
from freemesh_ray.cli.arguments import whole
from freemesh_ray.formatting.terminal import note, say

#: Processes at most.
MOST_PROCESSES = 1024

#: What is written where nothing is said.
FORMAT = ".msh"

#: Options that name a file which a mesh is made with.
FILES = ("policy", "size")


def add(parser: argparse.ArgumentParser) -> None:
    """Add the options of a batch to the grammar of ``mesh``."""
    batch = parser.add_argument_group("many files")
    batch.add_argument("--out", metavar="FOLDER", help="folder for the meshes of several POLYGONs; it is made")
    batch.add_argument("--format", action="append", default=[], metavar="SUFFIX",
                       help=f"of what is written to --out, as .inp or .png; repeatable ({FORMAT})")  # fmt: skip
    batch.add_argument("--jobs", type=whole(1, MOST_PROCESSES), metavar="N",
                       help="files at a time, each in a process of its own (the number of cores)")  # fmt: skip
    batch.add_argument("--resume", action="store_true",
                       help="leave out files whose meshes are in --out, and not older than they are")  # fmt: skip
    batch.add_argument("--ray", metavar="ADDRESS",
                       help="mesh on this Ray cluster, a core for each file (RAY_ADDRESS)")  # fmt: skip


def wanted(options: argparse.Namespace) -> bool:
    """Whether the command line asks for a batch.

    Raises:
        OutputError: for half of one.
    """
    from freemesh_ray.storage.atomic import OutputError

    if options.out is None:
        if len(options.domain) > 1:
            raise OutputError("mesh: several files: where to write? give --out FOLDER")
        for option in ("format", "jobs", "resume", "ray"):
            if getattr(options, option):
                raise OutputError(f"mesh: --{option} is for many files: give --out FOLDER, too")
        return False
    if options.output:
        raise OutputError("mesh: -o and --out: give one of the two; --format says what is written to --out")
    for option in ("list_names", "diagnose"):
        if getattr(options, option):
            raise OutputError(f"mesh: --{option.replace('_', '-')} and --out: it is for one file, without --out")
    return True


def run(options: argparse.Namespace, mesh: Callable[..., int]) -> int:
    """Mesh all files; a table at the end.

    Args:
        options: of the command line.
        mesh: ``cli.mesh.run``, which meshes one.

    Raises:
        OutputError, PolicyError: what is wrong before anything is begun.
    """
    from freemesh_ray.batch.outputs import draft_of, drafts
    from freemesh_ray.batch.summary import summary
    from freemesh_ray.batch.whole_batch import whole_batch

    formats = [one if one.startswith(".") else f".{one}" for one in dict.fromkeys(options.format)] or [FORMAT]
    check(options, formats)
    jobs = jobs_of(options.domain, split=options.split)
    folder, rows = Path(options.out), list[tuple[Job, Outcome]]()
    with drafts(folder) as made:
        if os.environ.get("RAY_ADDRESS"):
            doing = on_cluster(partial(mesh_elsewhere, options, formats, mesh), partial(contents, options))
        else:
            compile_first(options)
            for job in jobs:
                draft_of(job, made).mkdir()
            doing = in_processes(partial(mesh_here, options, formats, mesh, made), options.jobs or cores())
        try:
            whole_batch(jobs, doing, folder, made, formats, sys.stderr, split=options.split, resume=options.resume,
                        keep_going=options.keep_going, rows=rows)  # fmt: skip
        finally:
            if rows:
                say(summary(rows))
    failed = [outcome for _, outcome in rows if outcome.error]
    if failed:
        more = "" if options.keep_going or len(rows) == len(jobs) else "; --keep-going goes on with the others"
        note(f"freemesh: {len(failed)} of {len(jobs)} files failed{more}")
    return 0 if not failed else FAILED if options.keep_going else failed[0].code


def check(options: argparse.Namespace, formats: Sequence[str]) -> None:
    """Before anything is begun: what is wrong for every file.

    Raises:
        OutputError: a format that there is none of, or a folder that is meant as a file.
        PolicyError: no such policy.
    """
    from freemesh_ray.mesher.polygon_to_mesh import SUFFIXES
    from freemesh_ray.policies.policy import SHIPPED, Policy
    from freemesh_ray.storage.atomic import OutputError

    for suffix in formats:
        if suffix.lower() not in SUFFIXES:
            raise OutputError(f"mesh: --format {suffix}: unknown; use one of {', '.join(SUFFIXES)}")
    if Path(options.out).suffix.lower() in SUFFIXES and not Path(options.out).is_dir():
        raise OutputError(f"mesh: --out {options.out}: is named like a file; give a folder, or -o for one mesh")
    Policy.load(options.policy or SHIPPED[options.density])


def cores() -> int:
    """Those that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def compile_first(options: argparse.Namespace) -> None:
    """Compile the kernels here, once, if they are not yet: every process would."""
    from envs.kernels.ahead_of_time import missing
    from freemesh_ray.cli.kernel_progress import CompilingLine
    from freemesh_ray.mesher.warm_up import NOTICE, entries, warm_up
    from freemesh_ray.policies.policy import SHIPPED, Policy

    if missing(entries()):
        warm_up(Policy.load(options.policy or SHIPPED[options.density]), CompilingLine(sys.stderr, NOTICE).show)


def in_processes(work: Callable[[Job], Outcome], processes: int) -> Callable[[Sequence[Job]], Iterator[Any]]:
    """Does jobs on this machine."""
    from freemesh_ray.batch.process_pool import done_here

    return partial(done_here, work=work, processes=processes)


def on_cluster(
    work: Callable[[Job, Path, Path], Outcome], files: Callable[[Job], Mapping[str, bytes]]
) -> Callable[[Sequence[Job]], Iterator[Any]]:
    """Does jobs on the cluster of RAY_ADDRESS."""
    from freemesh_ray.batch.cluster import done_there

    return partial(done_there, work=work, files=files)


def mesh_here(
    options: argparse.Namespace, formats: Sequence[str], mesh: Callable[..., int], drafts: Path, job: Job
) -> Outcome:
    """Mesh one file into its draft's folder."""
    return mesh_one(argparse.Namespace(**{**vars(options), "domain": job.source}), formats, mesh, job,
                    drafts / str(job.number))  # fmt: skip


def mesh_elsewhere(
    options: argparse.Namespace, formats: Sequence[str], mesh: Callable[..., int], job: Job, given: Path, written: Path
) -> Outcome:
    """Mesh one file, which came with what it needs in the folder ``given``, into the folder ``written``."""
    own = {**vars(options), "domain": job.source}
    for key in ("domain", *FILES):
        if own[key] is not None and (there := given / key / Path(own[key]).name).is_file():
            own[key] = str(there)
    outcome = mesh_one(argparse.Namespace(**own), formats, mesh, job, written)
    for key in ("domain", *FILES):
        here = f"{given / key}{os.sep}"
        outcome.error = outcome.error.replace(here, "")
        outcome.notes = [line.replace(here, "") for line in outcome.notes]
    return outcome


def contents(options: argparse.Namespace, job: Job) -> dict[str, bytes]:
    """What a file's mesh is made of, the file and those that options name: each by what it is, and its name."""
    given = {"domain": job.source} | {key: getattr(options, key) for key in FILES}
    return {
        f"{key}/{Path(path).name}": Path(path).read_bytes()
        for key, path in given.items() if path is not None and os.path.isfile(path)
    }  # fmt: skip


def mesh_one(
    options: argparse.Namespace, formats: Sequence[str], mesh: Callable[..., int], job: Job, folder: Path
) -> Outcome:
    """Mesh one file into a folder; what the command would have said is in the outcome."""
    began, told, outcome = time.perf_counter(), StringIO(), Outcome()
    options.output = [str(folder / f"{job.stem}{suffix}") for suffix in formats]
    with redirect_stderr(told):
        try:
            outcome.code = mesh(options, lambda made, figures, paths: outcome.meshes.append(dict(figures)))
        except UserError as error:
            outcome.error, outcome.code = str(error), error.exit_code
        except MemoryError:
            outcome.error, outcome.code = f"{options.domain}: memory is short: use a larger edge length", FAILED
        except Exception as error:  # one file is not the end of all
            outcome.error, outcome.code = f"{options.domain}: {type(error).__name__}: {error}", FAILED
    if outcome.error:
        outcome.meshes.clear()  # what a part of it has become is not put anywhere
    outcome.notes = told.getvalue().splitlines()
    if outcome.code and not outcome.error:  # something was left out: the last line says what
        outcome.error = outcome.notes.pop() if outcome.notes else f"{options.domain}: failed"
    outcome.seconds = time.perf_counter() - began
    return outcome
