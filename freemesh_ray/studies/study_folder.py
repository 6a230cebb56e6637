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
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import yaml

from freemesh_ray import config
from freemesh_ray.storage.atomic import replacing
from freemesh_ray.training.run_folder import RunError

#: What a trial can be. ``stopped``: by a scheduler, before its budget.
STATUSES = ("pending", "running", "finished", "stopped", "failed")
#: Of trials that are not run any more.
OVER = ("finished", "stopped", "failed")


@dataclass
class Entry:
    """One trial in ``trials.json``.

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

    def claim(self, tree: dict[str, Any], resume: bool) -> None:
        """Make the folder for a study, or take it up again.

        Raises:
            RunError: it holds a study and ``resume`` is false, or another one, or it cannot be made.
            ConfigError: what it holds is damaged.
        """
        text = config.dump(tree)
        if self.definition.is_file():
            if not resume:
                raise RunError(
                    f"{self.path} already holds a study: add --resume to go on, "
                    "or --set paths.studies=OTHER to begin anew"
                )
            if config.read_plain(self.definition) != yaml.safe_load(text):
                raise RunError(
                    f"{self.definition} was begun with other settings: go on with the same, "
                    "or --set paths.studies=OTHER to begin another"
                )
            return
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RunError(f"{self.path}: cannot be made ({error.strerror}): set paths.studies elsewhere") from error
        with replacing(self.definition) as draft:
            draft.write_text(text)

    def write(self, entries: Sequence[Entry]) -> None:
        """Write ``trials.json``."""
        with replacing(self.trials) as draft:
            draft.write_text(json.dumps([asdict(entry) for entry in entries], indent=1))

    def read(self) -> list[Entry]:
        """Read ``trials.json``; nothing where there is none.

        Raises:
            RunError: it is damaged.
        """
        if not self.trials.is_file():
            return []
        try:
            entries = [Entry(**entry) for entry in json.loads(self.trials.read_text(encoding="utf-8"))]
            for entry in entries:
                _check(entry)
            return entries
        except (OSError, ValueError, TypeError, RecursionError) as error:
            reason = ascii(str(error))[1:-1][:100]
            raise RunError(
                f"{self.trials}: is not a list of trials ({reason}): move the study's folder away"
            ) from error

    def run_folders(self) -> list[Path]:
        """Where the trials lie; nothing where there is no study."""
        return [self.path / entry.run for entry in self.read()]


def _check(entry: Entry) -> None:
    """Refuse what is no trial.

    Raises:
        ValueError: as said.
    """
    kinds = {"label": str, "seed": int, "run": str, "status": str, "settings": dict | None, "error": str | None}
    for name, kind in kinds.items():
        if not isinstance(getattr(entry, name), kind):
            raise ValueError(f"{name} is {str(getattr(entry, name))[:40]!r}")
    if entry.status not in STATUSES:
        raise ValueError(f"status {entry.status[:40]!r} is none of {', '.join(STATUSES)}")
    if "\0" in entry.run:
        raise ValueError("run is no path")
