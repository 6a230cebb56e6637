"""The training of one seed of a trial, in its run folder: evaluation by evaluation."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

from freemesh_ray.config import dump, flatten
from freemesh_ray.storage.atomic import OutputError, replacing
from freemesh_ray.storage.lock import held
from freemesh_ray.studies import longer_training
from freemesh_ray.studies.completion_mark import FINISHED, finished
from freemesh_ray.studies.plan import Trial
from freemesh_ray.tracking import MLflowRun
from freemesh_ray.training import checkpoint
from freemesh_ray.training.callback import Callback, Callbacks, callbacks_named
from freemesh_ray.training.job import conclude, tags
from freemesh_ray.training.loop import Algorithm, Training


class SeedTraining:
    """One training; `begin` comes first.

    Args:
        trial: it.
        lengthened: whether it may go on when it was over: its checkpoints are kept in its run folder.
    """

    def __init__(self, trial: Trial, lengthened: bool) -> None:
        self.trial = trial
        self._lengthened = lengthened
        self._lock = ExitStack()
        self._training: Training | None = None
        self._run: MLflowRun | None = None
        self._figures: dict[str, Any] | None = None
        self._started = False

    def begin(
        self,
        make: Callable[[Mapping[str, Any]], Algorithm],
        callbacks: Sequence[Callback],
        parent: str | None,
        told_apart: Mapping[str, str],
    ) -> None:
        """Build what it needs, unless it was trained already; wait while another process trains it.

        Args:
            make: the algorithm's factory.
            callbacks: it has copies of its own.
            parent: id of the parent's run in the tracking store.
            told_apart: what the trainings of one parent are told apart by there.

        Raises:
            UserError: what is wrong with its settings, or its place.
        """
        trial = self.trial
        trial.folder.path.mkdir(parents=True, exist_ok=True)
        self._lock.enter_context(held(trial.folder.path, "wait", patience=math.inf))
        self._figures = finished(trial.folder)
        if self._figures is not None:  # by another study, or after Tune last wrote its record
            self._lock.close()
            return
        tracking = trial.config["tracking"]
        self._run = MLflowRun(
            trial.folder.path,
            uri=tracking["uri"],
            experiment=tracking["experiment"],
            name=trial.name,
            params={key: value for key, value in flatten(trial.config).items() if key != "name"},
            tags={**tags(trial.config), **told_apart},
            parent=parent,
            resume=True,
            folders=[*trial.config["paths"].values()],
            enabled=tracking["enabled"],
        )
        told = Callbacks([*copy.deepcopy(callbacks), *callbacks_named(trial.config)])
        self._training = Training(make(trial.config), trial.config, trial.folder, self._run, told)
        with replacing(trial.folder.config) as draft:
            draft.write_text(dump(trial.config), encoding="utf-8")
        self._run.artifact(trial.folder.config)

    def step(self) -> dict[str, Any]:
        """Train to the next evaluation; at the budget's end leave what `train` leaves.

        Returns:
            The evaluation's figures with ``env_steps``, ``updates``, ``seconds`` and ``done``.
        """
        if self._figures is not None:
            return {**self._figures, "done": True}
        training, run = self._training, self._run
        assert training is not None
        assert run is not None
        try:
            if training.progress.env_steps == 0:
                self._go_on(training, run)
            training.callbacks.check()  # only now: with the last figures came a checkpoint
            if not self._started:
                training.start()
            self._started = True
            figures: dict[str, Any] = training.to_next_evaluation() or training.folder.read_evaluations()[-1]
            # Population based training changes settings on the way, which parameters cannot tell.
            drawn = {f"setting/{key}": value for key, value in self.trial.drawn.items() if _is_number(value)}
            run.metrics(drawn, step=training.progress.env_steps)
            figures |= {key: getattr(training.progress, key) for key in ("env_steps", "updates", "seconds")}
            done = training.done()
            if done:
                self._finish(training, run, figures)
        except Exception:
            run.close("FAILED")
            raise
        return {**figures, "done": done}

    def _go_on(self, training: Training, run: MLflowRun) -> None:
        """Take up the newest checkpoint of the run folder, or of a shorter training; else begin anew."""
        folder = training.folder
        if not self._lengthened:
            folder.forget_after(-1)
            return
        longer = not checkpoint.found(folder.checkpoints) and longer_training.take_over(folder)
        try:
            training.resume()
        except checkpoint.CheckpointError:
            if checkpoint.found(folder.checkpoints):  # it can be read, and is another training's
                raise
            folder.forget_after(-1)  # none can be read
        if longer:
            for row in folder.read_evaluations():
                run.metrics({key: value for key, value in row.items() if "/" in key}, step=row["env_steps"])

    def _finish(self, training: Training, run: MLflowRun, figures: Mapping[str, Any]) -> None:
        """Leave what `train` leaves, a checkpoint to go on from, and the last figures."""
        training.callbacks.check()
        conclude(training)
        if self._lengthened:
            self._keep_last(training)
        with replacing(training.folder.path / FINISHED) as draft:
            draft.write_text(json.dumps(figures), encoding="utf-8")
        if self._lengthened:
            longer_training.remove_shorter(training.folder)
        run.close()
        self._lock.close()
        self._figures = dict(figures)

    @staticmethod
    def _keep_last(training: Training) -> None:
        """Keep a checkpoint of the end; on a full disk none: a longer training then begins anew."""
        folder = training.folder
        if any(path.name == f"step_{training.progress.env_steps:09d}" for path in checkpoint.found(folder.checkpoints)):
            return
        try:
            checkpoint.save(training.algorithm, vars(training.progress).copy(), folder.checkpoints, keep=1)
        except (OSError, OutputError) as error:
            training.callbacks.tell("on_note", f"{folder.checkpoints}: no last checkpoint ({error})")

    def save(self, path: Path) -> None:
        """Write a checkpoint into folder ``path``: algorithm, replay buffer and progress."""
        path.mkdir(parents=True, exist_ok=True)
        training = self._training
        if training is None:
            with replacing(path / FINISHED) as draft:
                draft.touch()
            return
        checkpoint.write(training.algorithm, vars(training.progress).copy(), path)
        if self._lengthened:
            with suppress(OSError, OutputError):  # Tune has one, too
                checkpoint.adopt(path, training.folder.checkpoints)
        training.callbacks.tell("on_checkpoint", path)

    def load(self, path: Path) -> None:
        """Go on from what `save` wrote, of this training or of another trial's."""
        if self._training is not None and (path / checkpoint.PROGRESS).is_file():
            self._training.restore(path)
            self._started = False

    def release(self) -> None:
        """Give back the run folder, as the kernel does for a process that is killed."""
        self._lock.close()

    def fail(self) -> None:
        """Say in the tracking store that it failed."""
        if self._run is not None:
            self._run.close("FAILED")

    def end(self) -> None:
        """End what it started."""
        if self._training is not None:
            self._training.algorithm.stop()
        if self._run is not None:
            self._run.close()
        self._training = self._run = None
        self.release()


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float)
