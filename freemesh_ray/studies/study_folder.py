"""The folder of a study: where its parts lie.

studies/NAME/study.yaml     what was asked for, with what was added since
             earlier.json   what it was before each extension
             source.json    what training ran (`freemesh_ray.studies.training_source`)
             trials.json    every trial: label, seed, settings, run folder, status
             tune/          Ray Tune's own record, to go on from
             runs/          the trials of a search; those of variants lie in paths.runs, for all studies
             report/        figures and tables
             tracking/      the tracking journal
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from envs.errors import UserError
from freemesh_ray import config
from freemesh_ray.config.paths import elsewhere
from freemesh_ray.storage.atomic import replacing
from freemesh_ray.storage.json_file import read_json
from freemesh_ray.studies.definition import Study, load
from freemesh_ray.studies.permitted_changes import refused
from freemesh_ray.studies.training_source import training_source
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
        return f"{self.label}-{self.seed}"


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
    def earlier(self) -> Path:
        """What it was before each extension."""
        return self.path / "earlier.json"

    @property
    def source(self) -> Path:
        """What training ran when it was begun."""
        return self.path / "source.json"

    @property
    def tune(self) -> Path:
        """Ray Tune's experiment."""
        return self.path / "tune"

    @property
    def tune_confirm(self) -> Path:
        """Ray Tune's experiment of what confirms a search."""
        return self.path / "tune-confirm"

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

    def going_on(self, study: Study, resume: bool) -> Study:
        """The study that is run here when ``study`` is asked for: one that was extended since goes on as it is now.

        Raises:
            StudyError: the folder holds a study and ``resume`` is false, or one that ``study`` does not extend.
            ConfigError: what it holds is damaged.
        """
        if not self.definition.is_file():
            return study
        if not resume:
            raise StudyError(
                f"{self.path} already holds a study: add --resume to go on, or --set paths.studies=OTHER to begin anew"
            )
        before = self.study()
        if study.tree() == before.tree():
            return study
        if _plain(study.tree()) in self.extensions():
            return before
        if changed := refused(before, study):
            raise StudyError(
                f"{self.definition} was begun with other settings, which cannot change: {', '.join(changed)}: "
                "go on with the same, or --set paths.studies=OTHER to begin another"
            )
        more = study.search is not None and before.search is not None and study.search.trials > before.search.trials
        if more and sum(record.status in OVER for record in self.read()) < before.trainings():
            raise StudyError(
                f"{self.path}: study.search.trials: the search is not over, and its searcher has to know all: "
                f"go on with {self.definition} first, then add trials"
            )
        return study

    def extensions(self) -> list[Any]:
        """The trees of the study before each extension.

        Raises:
            StudyError: their file is damaged.
        """
        try:
            found = read_json(self.earlier) if self.earlier.exists() else []
        except (OSError, ValueError) as error:
            raise StudyError(f"{self.earlier}: is damaged ({str(error)[:100]}): remove it") from error
        return found if isinstance(found, list) else []

    def make(self) -> None:
        """Make the folder, if it is not there.

        Raises:
            StudyError: it cannot be made.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StudyError(f"{self.path}: cannot be made ({error.strerror}): {elsewhere('paths.studies')}") from error

    def claim(self, study: Study, resume: bool) -> Study:
        """Write a study down in its folder, or take it up again, with what it is extended by.

        Returns:
            The study that is run, see `going_on`.

        Raises:
            StudyError, ConfigError: see `going_on`.
        """
        study = self.going_on(study, resume)
        if not self.definition.is_file():
            self._write_json(self.source, dict(training_source()))
        else:
            before = self.study()
            if study.tree() == before.tree():
                return study
            self._write_json(self.earlier, [*self.extensions(), before.tree()])
            self._forget_tune(before, study)
        with replacing(self.definition) as draft:
            draft.write_text(config.dump(study.tree()), encoding="utf-8")
        return study

    def _forget_tune(self, before: Study, now: Study) -> None:
        """Drop Tune's record, which has no room for more trials: what is not over goes on from the checkpoints in the
        run folders; a search that is given more trials is over.
        """
        shutil.rmtree(self.tune_confirm, ignore_errors=True)
        if now.search is None or before.search is None or now.search.trials > before.search.trials:
            shutil.rmtree(self.tune, ignore_errors=True)

    def changed_source(self) -> str:
        """What of the source is another than when the study was begun, in words; empty where nothing is known."""
        try:
            before = read_json(self.source)
            changed = [key for key, value in training_source().items() if before.get(key) != value]
        except (OSError, ValueError, AttributeError):
            return ""
        return f" ({', '.join(changed)})" if changed else ""

    @staticmethod
    def _write_json(path: Path, value: Any) -> None:
        with replacing(path) as draft:
            draft.write_text(json.dumps(value, indent=1), encoding="utf-8")

    def write(self, records: Sequence[TrialRecord]) -> None:
        """Write ``trials.json``."""
        self._write_json(self.trials, [asdict(record) for record in records])

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


def _plain(tree: Any) -> Any:
    """A tree as JSON gives it back."""
    return json.loads(json.dumps(tree))


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
