"""A training of more env steps goes on from where a shorter one of its lineage ended.

The newest checkpoint of a training that came to its end stays in its run folder for that; of one lineage that of the
longest.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from freemesh_ray.storage.atomic import replacing
from freemesh_ray.storage.json_file import read_json
from freemesh_ray.storage.regular_file import copied
from freemesh_ray.studies.completion_mark import finished
from freemesh_ray.studies.plan import lineage
from freemesh_ray.training import checkpoint
from freemesh_ray.training.run_folder import RunFolder


def shorter(folder: RunFolder) -> Iterator[RunFolder]:
    """The run folders of shorter trainings of a lineage, the longest first."""
    steps = length(folder.path)
    found = [path for path in folder.path.parent.glob(f"{lineage(folder.path)}-*") if 0 < length(path) < steps]
    yield from map(RunFolder, sorted(found, key=length, reverse=True))


def length(path: Path) -> int:
    """The env steps in a run folder's name; 0 where it has none."""
    steps = path.name.rpartition("-")[2]
    return int(steps) if steps.isdecimal() else 0


def take_over(folder: RunFolder) -> bool:
    """Give a run folder without checkpoints what the longest of the shorter trainings left; whether there was one.

    One that was stopped before its budget, by its time or a callback, is none: so would the longer be.
    """
    for other in shorter(folder):
        newest = next(iter(checkpoint.found(other.checkpoints)), None)
        if newest is None or finished(other) is None:
            continue
        with suppress(OSError, ValueError):  # another lengthens it, too, and was first to remove it
            if read_json(newest / checkpoint.PROGRESS)["env_steps"] < length(other.path):
                continue
            for kept, own in ((other.evaluations, folder.evaluations), (other.policy, folder.policy)):
                with replacing(own) as draft:
                    copied(kept, draft)
            checkpoint.adopt(newest, folder.checkpoints)
            return True
    return False


def remove_shorter(folder: RunFolder) -> None:
    """Remove the checkpoints of a finished training's shorter ones, which were kept to go on from."""
    for other in shorter(folder):
        if finished(other) is not None:
            shutil.rmtree(other.checkpoints, ignore_errors=True)
