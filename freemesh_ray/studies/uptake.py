"""Trainings taken up from records: they count as finished here, though another machine trained them.

A training is known by its ID and steps, the name of its run folder. Its record is opened into that folder: the
configuration, the evaluations, what was measured of its policy, and the file that says that it is finished. The policy
itself, and checkpoints to go on from, are not in records.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from freemesh_ray.config import dump
from freemesh_ray.records import measured_file, parquet_file
from freemesh_ray.records.schema import FILE
from freemesh_ray.records.study_records import RecordsError, Training
from freemesh_ray.storage.atomic import replacing
from freemesh_ray.storage.lock import held
from freemesh_ray.studies.completion_mark import FINISHED, finished
from freemesh_ray.studies.plan import Trial, VariantPlan


@dataclass(frozen=True)
class Uptake:
    """What became of recorded trainings.

    Attributes:
        taken: names of run folders that were opened from records.
        here: of those that were finished here already.
        unmatched: how many finished trainings of the records no trial asks for: other settings, seeds, steps or source.
    """

    taken: Sequence[str]
    here: Sequence[str]
    unmatched: int

    def __str__(self) -> str:
        told = f"{len(self.taken)} training{'' if len(self.taken) == 1 else 's'} taken from records"
        told += (
            f", {len(self.here)} more of them {'was' if len(self.here) == 1 else 'were'} here already"
            if self.here
            else ""
        )
        lost = f"{self.unmatched} do not match" if self.unmatched != 1 else "1 does not match"
        return f"{told}; {lost} (other settings, seed, steps or source)" if self.unmatched else told


def read(places: Iterable[str | Path]) -> dict[str, Training]:
    """The finished trainings in records by the names of their run folders.

    Args:
        places: records files, or folders that hold them, at any depth.

    Raises:
        RecordsError: there are none, or they cannot be read.
    """
    found: dict[str, Training] = {}
    for given in places:
        place = Path(given)
        files = sorted(place.rglob(FILE)) if place.is_dir() else [place]
        if not files:
            raise RecordsError(f"{place}: no {FILE} in it: give the file, or a folder that holds some")
        for file in files:
            for training in parquet_file.read(file).trainings:
                if training.status == "finished" and training.evaluations:
                    found.setdefault(training.run, training)
    return found


def take_up(plan: VariantPlan, recorded: Mapping[str, Training]) -> Uptake:
    """Open the records of a plan's trainings into their run folders, unless they are finished there.

    Raises:
        InUseError: another process trains one.
        OutputError: a place cannot be written to.
    """
    taken, here = [], []
    for trial in plan.trials.values():
        name = trial.folder.path.name
        if (training := recorded.get(name)) is None or name in taken or name in here:
            continue
        if finished(trial.folder) is not None:
            here.append(name)
            continue
        open_into(trial, training)
        taken.append(name)
    return Uptake(taken, here, len(recorded) - len(taken) - len(here))


def open_into(trial: Trial, training: Training) -> None:
    """Write a record as the run folder that the training would have left, but for its policy; the end's file last.

    Raises:
        InUseError, OutputError: see `take_up`.
    """
    folder, last = trial.folder, training.evaluations[-1]
    updates = {} if training.updates is None else {"updates": training.updates}
    lines = [json.dumps(dict(row)) for row in training.evaluations]
    folder.path.mkdir(parents=True, exist_ok=True)
    with held(folder.path, "wait for its end, or leave --records out"):
        folder.policy.unlink(missing_ok=True)  # of a beginning that was cut short
        for path, text in (
            (folder.config, dump(trial.config)),
            (folder.evaluations, "".join(f"{line}\n" for line in lines)),
        ):
            with replacing(path) as draft:
                draft.write_text(text, encoding="utf-8")
        if training.measured is not None:
            measured_file.write(folder.path, training.measured)
        with replacing(folder.path / FINISHED) as draft:
            draft.write_text(json.dumps({**last, **updates}), encoding="utf-8")
