"""The folder of a study: where its parts lie.

studies/NAME/study.yaml     what was asked for
             trials.json    every trial: label, seed, settings, run folder, status
             tune/          Ray Tune's own record, to go on from
             runs/          the trials of a search; those of variants lie in paths.runs, for all studies
             report/        figures and tables
             tracking/      the tracking journal
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from envs.errors import UserError
from freemesh_ray import config
from freemesh_ray.storage.atomic import replacing
from freemesh_ray.storage.json_file import read_json
from freemesh_ray.studies.definition import Study, load
from freemesh_ray.training.run_folder import RunFolder


class StudyError(UserError):
    """A study that cannot begin, go on or be read; one line with its folder, what is wrong and the fix."""


#: States of a trial. ``stopped``: by a scheduler, before its budget.
STATUSES = ("pending", "running", "finished", "stopped", "failed")
#: States of trials that are not run any more.
OVER = ("finished", "stopped", "failed")


@dataclass
class TrialRecord:
    """One trial as ``trials.json`` has it.

    Attributes:
        label, seed: which.
        run: its run folder, relative to the study's folder.
        status: one of STATUSES.
        settings: that a search drew, by dotted key.
        error: of a failed trial, in a line.
        shared: whether it was found finished, trained by another study.
    """

    label: str
    seed: int
    run: str
    status: str = "pending"
    settings: dict[str, Any] | None = None
    error: str | None = None
    shared: bool = False

    @property
    def name(self) -> str:
        """Unique in its study; the same as the planned trial's."""
        return self.label if self.settings else f"{self.label}-{self.seed}"


@dataclass(frozen=True)
class StudyFolder:
    """Paths below one study's folder.

    Attributes:
        path: the folder; it need not exist.
    """

    path: Path

    @property
    def definition(self) -> Path:
        """What was asked for."""
        return self.path / "study.yaml"

    @property
    def trials(self) -> Path:
        """Every trial."""
        return self.path / "trials.json"

    @property
    def tune(self) -> Path:
        """Ray Tune's experiment."""
        return self.path / "tune"

    @property
    def runs(self) -> Path:
        """The trials of a search."""
        return self.path / "runs"

    @property
    def report(self) -> Path:
        """Figures and tables."""
        return self.path / "report"

    def study(self) -> Study:
        """The study that was begun here.

        Raises:
            StudyError: there is none.
            ConfigError: its file is not a study's.
        """
        if not self.definition.is_file():
            there = sorted(path.parent.name for path in self.path.parent.glob("*/study.yaml"))
            known = f"there {'is' if len(there) == 1 else 'are'} {', '.join(there)}" if there else "there are none"
            raise StudyError(
                f"{self.path}: no such study: {known} in {self.path.parent}; `freemesh study NAME` begins one"
            )
        return replace(load(self.definition, beside=False), name=self.path.resolve().name)

    def claim(self, study: Study, resume: bool) -> None:
        """Make the folder for a study, or take it up again.

        Raises:
            StudyError: it holds a study and ``resume`` is false, or another one, or it cannot be made.
            ConfigError: what it holds is damaged.
        """
        if self.definition.is_file():
            if not resume:
                raise StudyError(
                    f"{self.path} already holds a study: add --resume to go on, "
                    "or --set paths.studies=OTHER to begin anew"
                )
            before, now = self.study().tree(), study.tree()
            changed = [
                f"{part}.{key}"
                for part in now
                for key in before[part] | now[part]
                if before[part].get(key) != now[part].get(key)
            ]
            if changed:
                raise StudyError(
                    f"{self.definition} was begun with other settings ({', '.join(changed)}): go on with the same, "
                    "or --set paths.studies=OTHER to begin another"
                )
            return
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StudyError(f"{self.path}: cannot be made ({error.strerror}): set paths.studies elsewhere") from error
        with replacing(self.definition) as draft:
            draft.write_text(config.dump(study.tree()), encoding="utf-8")

    def write(self, records: Sequence[TrialRecord]) -> None:
        """Write ``trials.json``."""
        with replacing(self.trials) as draft:
            draft.write_text(json.dumps([asdict(record) for record in records], indent=1), encoding="utf-8")

    def read(self) -> list[TrialRecord]:
        """Read ``trials.json``; nothing where there is none.

        Raises:
            StudyError: it is damaged.
        """
        if not self.trials.exists():
            return []
        try:
            records = [TrialRecord(**record) for record in read_json(self.trials)]
            for record in records:
                _check(record)
            return records
        except (OSError, ValueError, TypeError) as error:
            reason = str(error)[:100]
            raise StudyError(
                f"{self.trials}: is not a list of trials ({reason}): move the study's folder away"
            ) from error

    def run_of(self, record: TrialRecord) -> RunFolder:
        """The run folder of a trial."""
        return RunFolder(self.path / record.run)

    def run_folders(self) -> list[Path]:
        """Where the trials lie; nothing where there is no study."""
        return [self.run_of(record).path for record in self.read()]


def _check(record: TrialRecord) -> None:
    """Refuse what is no trial.

    Raises:
        ValueError: as said.
    """
    types = {"label": str, "seed": int, "run": str, "status": str, "settings": dict | None, "error": str | None}
    for name, accepted in types.items():
        if not isinstance(getattr(record, name), accepted):
            raise ValueError(f"{name} is {str(getattr(record, name))[:40]!r}")
    if record.status not in STATUSES:
        raise ValueError(f"status {record.status[:40]!r} is none of {', '.join(STATUSES)}")
    if "\0" in record.run:
        raise ValueError("run is no path")
