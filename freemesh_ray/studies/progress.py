"""What a running study shows: every trial's state in ``trials.json``, and lines of progress."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from ray.tune import Callback
from ray.tune.experiment import Trial as TuneTrial

from freemesh_ray.formatting.table import duration, number
from freemesh_ray.policies.evaluation import COMPLETION, RETURN
from freemesh_ray.studies.completion_mark import FINISHED
from freemesh_ray.studies.plan import Plan, Trial
from freemesh_ray.studies.study_folder import OVER, StudyFolder, TrialRecord

#: Seconds between two lines on how far the running trials are.
INTERVAL = 15.0
#: Takes the lines; not the callback's own, which is read again from what the study's first start wrote.
note: ContextVar[Callable[[str], None]] = ContextVar("note", default=lambda line: None)


class StudyProgress(Callback):
    """A callback of Ray Tune, which is pickled with the experiment.

    Args:
        folder: the study's folder, whose ``trials.json`` is there.
        experiment: Tune's folder.
        plan: its trials.
        planned: how many trainings there will be.
        budget: env steps of each.
        keep: whether checkpoints of trials that are over may still be needed, as by population based training.
    """

    def __init__(self, folder: Path, experiment: Path, plan: Plan, planned: int, budget: int, keep: bool) -> None:
        self._folder, self._plan, self._planned, self._budget = StudyFolder(folder), plan, planned, budget
        self._experiment = experiment.name
        self._keep = keep
        self._over: list[Path] = []
        self._figures: dict[str, dict[str, Any]] = {}

    def setup(self, *args: Any, **info: Any) -> None:
        """The experiment begins, or goes on with the trials of ``trials.json``."""
        self._records = {record.run: record for record in self._folder.read()}
        self._before = {run for run, record in self._records.items() if record.status in OVER}
        self._began = self._told = time.monotonic()

    def on_trial_start(self, iteration: int, trials: list[TuneTrial], trial: TuneTrial, **info: Any) -> None:
        """A trial begins, or goes on."""
        fresh = self._records_of(trial)[0].status == "pending"
        self._set(trial, "running")
        if fresh:
            self._say(f"{self._prefix()}  {self._name(trial)}  begins")

    def on_trial_result(
        self, iteration: int, trials: list[TuneTrial], trial: TuneTrial, result: dict[str, Any], **info: Any
    ) -> None:
        """A trial evaluated itself."""
        self._figures |= {record.run: result for record in self._records_of(trial)}
        self._remove_checkpoints()
        if time.monotonic() - self._told >= INTERVAL:
            self._told = time.monotonic()
            running = [self._line(t) for t in trials if t.status == "RUNNING"]
            self._say(f"{self._prefix()}  {'   '.join(running)}{self._time_left()}")

    def on_trial_complete(self, iteration: int, trials: list[TuneTrial], trial: TuneTrial, **info: Any) -> None:
        """A trial came to its end, or a scheduler stopped it."""
        self._set(trial, "stopped")
        self._over.append(self._folder.path / self._experiment / Path(trial.path or "").name)
        self._say(f"{self._prefix()}  {self._line(trial)}  {self._records_of(trial)[0].status}")

    def on_experiment_end(self, trials: list[TuneTrial], **info: Any) -> None:
        """Nothing runs any more."""
        self._remove_checkpoints()

    def on_trial_error(self, iteration: int, trials: list[TuneTrial], trial: TuneTrial, **info: Any) -> None:
        """A trial failed for good."""
        self._set(trial, "failed", reason(trial))
        self._say(f"{self._prefix()}  {self._name(trial)}  failed: {reason(trial)}")

    def on_trial_recover(self, iteration: int, trials: list[TuneTrial], trial: TuneTrial, **info: Any) -> None:
        """A trial failed and is tried again."""
        self._say(f"{self._prefix()}  {self._name(trial)}  is tried again after: {reason(trial)}")

    def _remove_checkpoints(self) -> None:
        """Remove the checkpoints of trials that are over: each holds a whole replay buffer."""
        for place in [] if self._keep else self._over:
            for checkpoint in place.glob("checkpoint_*"):
                shutil.rmtree(checkpoint, ignore_errors=True)

    def _of(self, trial: TuneTrial) -> list[tuple[TrialRecord, Trial]]:
        """Its trainings as they are listed, and as they are now: population based training changes settings."""
        found = []
        for it in self._plan.trainings(trial.config, trial.trial_id):
            run = os.path.relpath(it.folder.path, self._folder.path.absolute())
            listed = TrialRecord(it.label, it.seed, run, settings=dict(it.drawn) if it.drawn else None)
            found.append((self._records.setdefault(run, listed), it))
        return found

    def _records_of(self, trial: TuneTrial) -> list[TrialRecord]:
        return [record for record, _ in self._of(trial)]

    def _name(self, trial: TuneTrial) -> str:
        records = self._records_of(trial)
        return records[0].name if len(records) == 1 else records[0].label

    def _set(self, trial: TuneTrial, status: str, error: str | None = None) -> None:
        """Note the state of its trainings; what came to its end stays finished."""
        for record, it in self._of(trial):
            whole = (self._folder.path / record.run / FINISHED).is_file()
            record.status = "finished" if whole else status
            record.settings = dict(it.drawn) if it.drawn else None
            record.error = None if whole else error
        self._folder.write(list(self._records.values()))

    def _line(self, trial: TuneTrial) -> str:
        name, figures = self._name(trial), self._figures.get(self._records_of(trial)[0].run)
        if figures is None:
            return f"{name} begins"
        return (
            f"{name} at {figures['env_steps']:,}: return {number(figures.get(RETURN, float('nan')), '.1f')}, "
            f"done {number(figures.get(COMPLETION, float('nan')), '.0%')}"
        )

    def _prefix(self) -> str:
        over = sum(record.status in OVER for record in self._records.values())
        return f"[{duration(time.monotonic() - self._began)}] {over}/{self._planned}"

    def _time_left(self) -> str:
        """The time that is left, estimated from the env steps taken since this start; empty before there are any."""
        new = [record for run, record in self._records.items() if run not in self._before]
        taken = sum(self._budget if record.status in OVER else self._steps(record) for record in new)
        open_ = self._budget * (self._planned - len(self._before)) - taken
        return f"   {duration((time.monotonic() - self._began) * open_ / taken)} left" if taken else ""

    def _steps(self, record: TrialRecord) -> int:
        return min(self._budget, int(self._figures.get(record.run, {}).get("env_steps", 0)))

    @staticmethod
    def _say(line: str) -> None:
        note.get()(line)


def reason(trial: TuneTrial) -> str:
    """Why a trial failed, in one line."""
    error = trial.get_error()
    lines = [line for line in str(error).splitlines() if line.strip()] if error else []
    return lines[-1].strip()[:200] if lines else "unknown: see the logs of Ray"
