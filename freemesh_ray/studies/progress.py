"""What a running study shows: every trial's state in ``trials.json``, and lines on the console."""

from __future__ import annotations

import os
import shutil
import sys
import time
from pathlib import Path
from typing import Any

from ray.tune import Callback
from ray.tune.experiment import Trial as TuneTrial

from freemesh_ray.formatting.table import duration, number
from freemesh_ray.studies.plan import Plan, Trial
from freemesh_ray.studies.study_folder import OVER, Entry, StudyFolder
from freemesh_ray.studies.trainable import FINISHED

#: Seconds between two lines on how far the running trials are.
INTERVAL = 15.0
#: Figures of a trial's last evaluation that a line shows.
RETURN, RATE = "eval_deterministic/return", "eval_deterministic/completion_rate"


class Board(Callback):
    """A callback of Ray Tune; it is stored with the experiment, so it holds nothing that cannot be.

    Args:
        folder: the study's folder, whose ``trials.json`` is there.
        plan: its trials.
        planned: how many there will be.
        budget: env steps of each.
        keep: whether checkpoints of trials that are over may still be needed, as by population based training.
    """

    def __init__(self, folder: Path, plan: Plan, planned: int, budget: int, keep: bool) -> None:
        self._folder, self._plan, self._planned, self._budget = StudyFolder(folder), plan, planned, budget
        self._keep = keep
        self._over: list[Path] = []
        self._figures: dict[str, dict[str, Any]] = {}

    def setup(self, *args: Any, **info: Any) -> None:
        """The experiment begins, or goes on: what is known of its trials is in their file."""
        self._entries = {entry.run: entry for entry in self._folder.read()}
        self._before = {run for run, entry in self._entries.items() if entry.status in OVER}
        self._began = self._told = time.monotonic()

    def on_trial_start(self, iteration: int, trials: list[TuneTrial], trial: TuneTrial, **info: Any) -> None:
        """A trial begins, or goes on."""
        fresh = self._entry(trial).status == "pending"
        self._set(trial, "running")
        if fresh:
            self._say(f"{self._count()}  {self._name(trial)}  begins")

    def on_trial_result(
        self, iteration: int, trials: list[TuneTrial], trial: TuneTrial, result: dict[str, Any], **info: Any
    ) -> None:
        """A trial evaluated itself."""
        self._figures[self._name(trial)] = result
        self._sweep()
        if time.monotonic() - self._told >= INTERVAL:
            self._told = time.monotonic()
            running = [self._glance(self._name(t)) for t in trials if t.status == "RUNNING"]
            self._say(f"{self._count()}  {'   '.join(running)}{self._left()}")

    def on_trial_complete(self, iteration: int, trials: list[TuneTrial], trial: TuneTrial, **info: Any) -> None:
        """A trial came to its end, or a scheduler stopped it."""
        entry = self._entry(trial)
        whole = (self._folder.path / entry.run / FINISHED).is_file()
        self._set(trial, "finished" if whole else "stopped")
        self._over.append(self._folder.tune / Path(trial.path or "").name)
        self._say(f"{self._count()}  {self._glance(self._name(trial))}  {entry.status}")

    def on_experiment_end(self, trials: list[TuneTrial], **info: Any) -> None:
        """Nothing runs any more."""
        self._sweep()

    def on_trial_error(self, iteration: int, trials: list[TuneTrial], trial: TuneTrial, **info: Any) -> None:
        """A trial failed for good."""
        entry = self._entry(trial)
        entry.error = reason(trial)
        self._set(trial, "failed")
        self._say(f"{self._count()}  {self._name(trial)}  failed: {entry.error}")

    def on_trial_recover(self, iteration: int, trials: list[TuneTrial], trial: TuneTrial, **info: Any) -> None:
        """A trial failed and is tried again."""
        self._say(f"{self._count()}  {self._name(trial)}  is tried again after: {reason(trial)}")

    def _sweep(self) -> None:
        """Remove the checkpoints of trials that are over: each holds a whole replay buffer."""
        for place in [] if self._keep else self._over:
            for checkpoint in place.glob("checkpoint_*"):
                shutil.rmtree(checkpoint, ignore_errors=True)

    def _of(self, trial: TuneTrial) -> tuple[Entry, Trial]:
        """The trial as it is listed, and as it is now: population based training changes settings on the way."""
        it = self._plan.trial(trial.config, trial.trial_id)
        run = os.path.relpath(it.folder.path, self._folder.path.absolute())
        return self._entries.setdefault(run, Entry(it.label, it.seed, run, settings=dict(it.drawn))), it

    def _name(self, trial: TuneTrial) -> str:
        return name_of(self._entry(trial))

    def _entry(self, trial: TuneTrial) -> Entry:
        return self._of(trial)[0]

    def _set(self, trial: TuneTrial, status: str) -> None:
        entry, it = self._of(trial)
        entry.status, entry.settings = status, dict(it.drawn)
        if status != "failed":
            entry.error = None
        self._folder.write(list(self._entries.values()))

    def _glance(self, name: str) -> str:
        figures = self._figures.get(name)
        if figures is None:
            return f"{name} begins"
        return (
            f"{name} at {figures['env_steps']:,}: return {number(figures.get(RETURN, float('nan')), '.1f')}, "
            f"done {number(figures.get(RATE, float('nan')), '.0%')}"
        )

    def _count(self) -> str:
        over = sum(entry.status in OVER for entry in self._entries.values())
        return f"[{duration(time.monotonic() - self._began)}] {over}/{self._planned}"

    def _left(self) -> str:
        """The time that is left, as if trials went on as they have since this start; nothing before there is a sign."""
        new = [entry for run, entry in self._entries.items() if run not in self._before]
        taken = sum(self._budget if entry.status in OVER else self._steps(entry) for entry in new)
        open_ = self._budget * (self._planned - len(self._before)) - taken
        return f"   {duration((time.monotonic() - self._began) * open_ / taken)} left" if taken else ""

    def _steps(self, entry: Entry) -> int:
        return min(self._budget, int(self._figures.get(name_of(entry), {}).get("env_steps", 0)))

    @staticmethod
    def _say(line: str) -> None:
        print(line, file=sys.stdout, flush=True)


def name_of(entry: Entry) -> str:
    """The trial's name, as in its plan."""
    return entry.label if entry.settings else f"{entry.label}-{entry.seed}"


def reason(trial: TuneTrial) -> str:
    """Why a trial failed, in one line."""
    error = trial.get_error()
    lines = [line for line in str(error).splitlines() if line.strip()] if error else []
    return lines[-1].strip()[:200] if lines else "unknown: see the logs of Ray"
