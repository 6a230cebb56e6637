"""The training loop: iterate, evaluate, checkpoint, keep the best policy.

It is given an algorithm and a place for its metrics, so that a test can hand it fakes.
"""

from __future__ import annotations

import json
import os
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn, Protocol

import numpy as np

from envs.domains.load import source
from envs.errors import PluginError
from envs.plug_ins.environment_parts import NONE
from freemesh_ray.algorithms.awake import awake
from freemesh_ray.algorithms.cut import Cut
from freemesh_ray.config import ALGORITHMS, algorithm_name, meshing_parameters, plug_ins
from freemesh_ray.policies.evaluation import COMPLETION, MODES, RETURN, metric
from freemesh_ray.policies.policy import Policy
from freemesh_ray.storage.atomic import OutputError, refusing_links
from freemesh_ray.tracking import MLflowRun
from freemesh_ray.tracking.provenance import provenance
from freemesh_ray.training import checkpoint, metrics
from freemesh_ray.training.callback import Callbacks
from freemesh_ray.training.run_folder import RunFolder
from freemesh_ray.training.status import Progress, Status

#: Episodes that the running figures of the progress line are means of.
RECENT = 50
#: Seconds that an iteration takes at least: a clock may stand still in it.
SHORTEST = 1e-9


class Algorithm(Protocol):
    """What the loop needs of a learning algorithm."""

    env_steps: int
    updates: int
    curriculum: Any
    finished: list[Any]
    incidents: list[str]

    def train(self) -> dict[str, Any]:
        """One iteration; a result tree as RLlib's. `Cut` leaves it early, with all that was done until then."""

    def evaluate(self) -> dict[str, Any]:
        """Figures by mode (deterministic, stochastic) and domain."""

    def actor_weights(self) -> list[tuple[Any, Any]]:
        """Layers of the policy network."""

    def critic_weights(self) -> list[tuple[Any, Any]]:
        """Layers of the critics, side by side."""

    def get_state(self) -> dict[str, Any]:
        """All that it is, for a checkpoint."""

    def set_state(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint's."""

    def reseed(self, seed: int) -> None:
        """Draw other random numbers from here on."""

    def stop(self) -> None:
        """End its processes."""


@dataclass
class Training:
    """The loop over one algorithm.

    Attributes:
        algorithm: trained in place.
        config: the resolved tree.
        folder: where the run's files lie.
        run: where metrics go.
        callbacks: told of what happens.
        interrupted: asked after every iteration and for every mesh at the end; when it says so, a checkpoint is saved
            and KeyboardInterrupt raised.
    """

    algorithm: Algorithm
    config: Mapping[str, Any]
    folder: RunFolder
    run: MLflowRun
    callbacks: Callbacks = field(default_factory=Callbacks)
    interrupted: Callable[[], bool] = lambda: False
    progress: Progress = field(default_factory=Progress)

    def __post_init__(self) -> None:
        self._recent: deque[Any] = deque(maxlen=RECENT)
        self._stages = [source(stage).name for stage in self.config["curriculum"]["stages"]]
        self._saved_at = self._tried_at = -1
        #: Of evaluations, and not written yet: lines, and the best policy.
        self._rows: list[bytes] = []
        self._best: Policy | None = None
        self._clock = awake()

    def resume(self) -> bool:
        """Go on from the newest checkpoint that can be read, if there is one; damaged ones are set aside.

        Raises:
            CheckpointError: there are checkpoints, and none can be read, or the newest is of another training.
        """
        damaged = None
        for path in checkpoint.found(self.folder.checkpoints):
            try:
                read = checkpoint.read(path)
            except checkpoint.CheckpointError as error:
                self._note(f"{error}; set aside as {checkpoint.set_aside(path).name}, going back to the one before")
                damaged = error
                continue
            self._take_over(path, *read)
            progress = self.progress
            self._note(f"going on from {path} ({progress.env_steps:,} steps, {progress.seconds / 60:.1f} min)")
            return True
        self.folder.forget_after(-1)
        if damaged:
            raise checkpoint.CheckpointError(f"{damaged}; there is no older one: begin anew without --resume")
        return False

    def restore(self, path: Path) -> None:
        """Go on from the checkpoint in folder ``path``.

        Raises:
            CheckpointError: it cannot be read.
        """
        self._take_over(path, *checkpoint.read(path))

    def _take_over(self, path: Path, state: dict[str, Any], progress: dict[str, Any]) -> None:
        checkpoint.hand_over(self.algorithm, state, path)
        try:
            self.progress = Progress(**progress)
        except TypeError as error:
            raise checkpoint.CheckpointError(f"{path}: not a checkpoint of this version ({error})") from error
        self._rows, self._best = [], None
        self.folder.forget_after(self.progress.env_steps)
        self._saved_at = self._tried_at = self.progress.env_steps

    def save(self) -> Path:
        """Write a checkpoint of this moment, unless there is one.

        Raises:
            OutputError: it cannot be written.
        """
        if self._saved_at == self.progress.env_steps and (found := checkpoint.found(self.folder.checkpoints)):
            return found[0]
        self._tick()
        self._tried_at = self.progress.env_steps
        keep = self.config["checkpoint"]["keep"]
        try:
            self._write_evaluations()
            path = checkpoint.save(self.algorithm, vars(self.progress).copy(), self.folder.checkpoints, keep)
        except (OSError, OutputError) as error:
            where = self.folder.checkpoints
            raise OutputError(f"{where}: no checkpoint at {self._tried_at:,} steps ({_reason(error)})") from error
        self._saved_at = self.progress.env_steps
        self.callbacks.tell("on_checkpoint", path)
        return path

    def done(self) -> bool:
        """Whether the budget is spent, or a callback stopped it."""
        budget = self.config["budget"]
        out_of_time = budget["minutes"] is not None and self.progress.seconds >= 60 * budget["minutes"]
        return self.callbacks.stopped or out_of_time or self.progress.env_steps >= budget["env_steps"]

    def loop(self) -> None:
        """Train until the budget is spent; evaluate and checkpoint on the way and at the end.

        A checkpoint or an evaluation that cannot be written, on a full disk or to a shared folder that is away, is
        tried again later; only the last must be.

        Raises:
            KeyboardInterrupt: ``interrupted`` said so; everything up to then is in a checkpoint.
            Exception: whatever the algorithm raised; everything up to the last checkpoint is in it.
            OutputError: the last checkpoint, or what goes with it, cannot be written.
            PluginError: a callback raised, or another plug-in failed; everything up to then is in a checkpoint.
        """
        self._clock = awake()
        progress = self.progress
        self.start()
        while not self.done():
            try:
                self._iterate()
                if self._evaluation_due():
                    self.evaluate()
            except Cut:
                self._catch_up()
            except PluginError as error:
                self._leave_for(error)
            if progress.env_steps - max(0, self._tried_at) >= self.config["checkpoint"]["interval"]:
                try:
                    self.save()
                except OutputError as error:
                    self._note(f"{error}; training goes on, the next is tried later")
            self.leave_if_told()
        if progress.evaluated_at < progress.env_steps or progress.best is None:
            try:
                self.evaluate()
            except Cut:
                pass
            except PluginError as error:
                self._leave_for(error)
        self.save()
        self.leave_if_told()

    def start(self) -> None:
        """Tell the callbacks that it begins, or goes on.

        Raises:
            PluginError: one raised; there is nothing to save yet.
        """
        self.callbacks.tell("on_start", self)
        self.callbacks.check()

    def _leave_for(self, error: PluginError) -> NoReturn:
        """Save a checkpoint, and raise the error of a plug-in with where to go on from.

        Raises:
            PluginError: as said.
        """
        self._catch_up()
        if not self.progress.env_steps:
            raise error
        try:
            path = self.save()
        except OutputError as lost:
            raise PluginError(f"{error}; {lost}") from error
        raise PluginError(f"{error}; --resume goes on from {path}") from error

    def leave_if_told(self) -> None:
        """Save a checkpoint, if there is none of this moment, where ``interrupted`` says so or a callback raised.

        Raises:
            KeyboardInterrupt: it did.
            PluginError: a callback raised.
            OutputError: the checkpoint cannot be written.
        """
        if self.callbacks.error is not None:
            with suppress(OutputError):
                self.save()
        self.callbacks.check()
        if self.interrupted() or self.callbacks.interruption is not None:
            path = self.save()
            self._note(f"interrupted at {self.progress.env_steps:,} steps; saved {path}: --resume goes on from it")
            raise self.callbacks.interruption or KeyboardInterrupt

    def to_next_evaluation(self) -> dict[str, float]:
        """Train until the next evaluation is due or the budget is spent, and evaluate.

        Returns:
            The evaluation's figures; none when the budget was spent before.

        Raises:
            OutputError: they cannot be written.
        """
        self._clock = awake()
        values: dict[str, float] = {}
        while not self.done() and not values:
            self._iterate()
            if self._evaluation_due() or self.done():
                values = self.evaluate()
        try:
            self._write_evaluations()
        except OSError as error:
            raise OutputError(f"{self.folder.evaluations}: cannot be written ({_reason(error)}): make room") from error
        self._tick()
        return values

    def _evaluation_due(self) -> bool:
        interval = self.config["evaluation"]["interval"]
        return self.progress.env_steps // interval > self.progress.evaluated_at // interval

    def _tick(self) -> None:
        """Add the time since the last tick to the training's."""
        now = awake()
        self.progress.seconds += now - self._clock
        self._clock = now

    def _iterate(self) -> None:
        began, updates = awake(), self.algorithm.updates
        stage = self.algorithm.curriculum.name
        results = self.algorithm.train()
        took = max(awake() - began, SHORTEST)
        progress = self.progress
        self._catch_up()
        self._recent.extend(self.algorithm.finished)
        iteration = metrics.Iteration(
            self.algorithm.curriculum.stage, progress.updates, progress.seconds, progress.updates - updates, took
        )
        figures = ALGORITHMS[algorithm_name(self.config["algorithm"])].figures
        values = metrics.of_iteration(iteration, self.algorithm.finished, results, figures)
        self.run.metrics(values, step=progress.env_steps)
        self.algorithm.finished.clear()
        if self.algorithm.curriculum.name != stage:
            self._note(f"stage {stage} -> {self.algorithm.curriculum.name} at {progress.env_steps:,} steps")
        self.callbacks.tell("on_iteration", self._status((progress.updates - updates) / took))

    def _note(self, line: str) -> None:
        self.callbacks.tell("on_note", line)

    def _catch_up(self) -> None:
        """Count and tell what the algorithm has done since it was last asked."""
        self.progress.env_steps, self.progress.updates = self.algorithm.env_steps, self.algorithm.updates
        self._tick()
        for incident in self.algorithm.incidents:
            self._note(incident)
        self.algorithm.incidents.clear()

    def _status(self, updates_per_second: float) -> Status:
        budget, progress = self.config["budget"], self.progress
        share = progress.env_steps / budget["env_steps"]
        left = progress.seconds * (1 / share - 1) if share else float("inf")
        if budget["minutes"] is not None:
            left = min(left, 60 * budget["minutes"] - progress.seconds)
        recent = self._recent
        return Status(
            stage=self.algorithm.curriculum.name,
            env_steps=progress.env_steps,
            budget_steps=budget["env_steps"],
            mean_return=float(np.mean([e.episode_return for e in recent])) if recent else float("nan"),
            completion_rate=float(np.mean([e.completed for e in recent])) if recent else float("nan"),
            updates_per_second=updates_per_second,
            seconds_left=max(0.0, left),
        )

    def policy(self, **about: Any) -> Policy:
        """The policy as it is now."""
        layers = [(np.asarray(w), np.asarray(b)) for w, b in self.algorithm.actor_weights()]
        critic = [(np.asarray(w), np.asarray(b)) for w, b in self.algorithm.critic_weights()]
        told = {**provenance(), "config": dict(self.config), **about}
        own = plug_ins(self.config)
        if own != NONE:  # what the critics expect is not what the mesher weighs
            critic = []
        return Policy(layers, meshing_parameters(self.config), told, critic, own)

    def evaluate(self) -> dict[str, float]:
        """Ten episodes (``evaluation.episodes``) on every stage, deterministic and stochastic; keep the best policy.

        The best is the one that completes most, over all stages and deterministically, and of those the one with the
        highest return; of equal ones the later.
        """
        found = self.algorithm.evaluate()
        values: dict[str, float] = {}
        for mode in MODES:
            figures = [found[mode][stage] for stage in self._stages]
            for stage, means in zip(self._stages, figures, strict=True):
                values |= {metric(mode, name, stage): value for name, value in means.items()}
            for name in figures[0]:
                values[metric(mode, name)] = float(np.mean([means[name] for means in figures]))
        self.progress.evaluated_at = self.progress.env_steps
        self.run.metrics(values, step=self.progress.env_steps)
        row = {"env_steps": self.progress.env_steps, "seconds": round(self.progress.seconds, 1), **values}
        self._rows.append(f"{json.dumps(row)}\n".encode())
        score = [values[COMPLETION], values[RETURN]]
        if self.progress.best is None or score >= self.progress.best:
            self.progress.best, self.progress.best_steps = score, self.progress.env_steps
            self._best = self.policy(env_steps=self.progress.env_steps, scores=values)
        try:
            self._write_evaluations()
        except (OSError, OutputError) as error:
            where = f"{self.folder.path}: no evaluation written"
            self._note(f"{where} ({_reason(error)}); training goes on, it comes later")
        self.callbacks.tell("on_evaluation", row)
        return values

    def _write_evaluations(self) -> None:
        """Write what evaluations have found that is not written yet: a checkpoint has all before it.

        Raises:
            OSError, OutputError: it cannot be written; what was not comes with the next try.
        """
        while self._rows:
            with open(self.folder.evaluations, "ab+", opener=refusing_links) as file:
                if file.seek(0, os.SEEK_END):
                    file.seek(-1, os.SEEK_END)
                    if file.read(1) != b"\n":  # a line that was cut short, by a full disk or a kill
                        file.write(b"\n")
                file.write(self._rows[0])
            del self._rows[0]
        if self._best is not None:
            self._best.save(self.folder.policy)
            self._best = None


def _reason(error: Exception) -> str:
    """Why something could not be written."""
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
