"""Where a batch writes: each file's meshes appear together in the folder, whole, when all of them are made."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from freemesh_ray.batch.inputs import Job
from freemesh_ray.storage.atomic import OutputError, check_writable


@contextmanager
def drafts(folder: Path) -> Iterator[Path]:
    """A new folder in ``folder``, which is made, for what is not whole yet; removed at the end.

    Raises:
        OutputError: the place cannot be written to.
    """
    if folder.is_file():
        raise OutputError(f"{folder}: is a file; give --out a folder")
    check_writable(folder / "mesh", parents=True)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        made = Path(tempfile.mkdtemp(prefix=".draft-", dir=folder))
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror or error}): check the place") from error
    try:
        yield made
    finally:
        shutil.rmtree(made, ignore_errors=True)


def draft_of(job: Job, drafts: Path) -> Path:
    """The folder that a job writes to."""
    return drafts / str(job.number)


def put(draft: Path, files: Mapping[str, bytes], folder: Path) -> None:
    """Put what a job has written, or what it brought back, into the folder.

    Raises:
        OutputError: the place cannot be written to.
    """
    umask = os.umask(0)
    os.umask(umask)
    try:
        draft.mkdir(exist_ok=True)
        for name, content in files.items():
            (draft / Path(name).name).write_bytes(content)
        for path in sorted(draft.iterdir()):
            place = folder / path.name
            if path.is_dir():
                shutil.rmtree(place, ignore_errors=True)
            os.replace(path, place)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror or error}): check the place") from error
