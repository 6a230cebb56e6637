"""One trial as Ray Tune runs it: a training, evaluation by evaluation, with checkpoints that Tune keeps."""

from __future__ import annotations

import copy
import json
import logging
import math
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from ray import tune

from envs.errors import UserError
from freemesh_ray.algorithms.build import build
from freemesh_ray.algorithms.device import cluster_gpus, gpus_per_learner
from freemesh_ray.config import dump, flatten
from freemesh_ray.storage.atomic import replacing
from freemesh_ray.storage.json_file import read_json
from freemesh_ray.storage.lock import held
from freemesh_ray.studies.plan import Plan, Trial
from freemesh_ray.tracking import MLflowRun
from freemesh_ray.training import checkpoint
from freemesh_ray.training.callback import Callback, Callbacks, callbacks_named
from freemesh_ray.training.job import conclude, tags
from freemesh_ray.training.loop import Algorithm, Training
from freemesh_ray.training.run_folder import RunFolder

#: Says that a run folder's training came to its end, and holds its last figures; the last file written.
FINISHED = "finished.json"


def finished(folder: RunFolder) -> dict[str, Any] | None:
    """The last figures of a training that came to its end; None where it did not, or where they are damaged."""
    try:
        figures = read_json(folder.path / FINISHED)
    except (OSError, ValueError):
        return None
    return figures if isinstance(figures, dict) else None


class TrainingTrainable(tune.Trainable):
    """A training whose step is the way to its next evaluation."""

    def setup(
        self,
        config: Mapping[str, Any],
        make: Callable[[Mapping[str, Any]], Algorithm] = build,
        callbacks: Sequence[Callback] = (),
    ) -> None:
        """Begin a trial.

        Args:
            config: as Tune gives it.
            make: the algorithm's factory.
            callbacks: every trial has copies of its own.
        """
        _quiet()
        self._make, self._callbacks = make, callbacks
        self._try_to_begin(config)

    def trial(self, given: Mapping[str, Any]) -> Trial:
        """The trial of Tune's configuration."""
        raise NotImplementedError

    def family(self, trial: Trial) -> tuple[str | None, dict[str, str]]:
        """The id of the parent's run in the tracking store, and what trials of one parent are told apart by."""
        raise NotImplementedError

    def reset_config(self, new_config: Mapping[str, Any]) -> bool:
        """Begin another trial in this process: what is imported and compiled stays."""
        self._end()
        self._try_to_begin(new_config)
        return True

    def _try_to_begin(self, config: Mapping[str, Any]) -> None:
        """Begin a trial, or keep for its first step why it cannot: who dies in `setup` leaves pages to read."""
        self.lock = ExitStack()
        self._training: Training | None = None
        self._run: MLflowRun | None = None
        self._refused: UserError | None = None
        try:
            self._begin(self.trial(config))
        except UserError as error:
            self._refused = error

    def _begin(self, trial: Trial) -> None:
        trial.folder.path.mkdir(parents=True, exist_ok=True)
        # Another study may train the same: wait for its figures, or for the folder.
        self.lock.enter_context(held(trial.folder.path, "wait", patience=math.inf))
        self._figures = finished(trial.folder)
        if self._figures is not None:  # by another study, or after Tune last wrote its record
            self.lock.close()
            return
        tracking = trial.config["tracking"]
        parent, told_apart = self.family(trial)
        self._run = MLflowRun(
            trial.folder.path,
            uri=tracking["uri"],
            experiment=tracking["experiment"],
            name=trial.name,
            params=flatten(trial.config),
            tags={**tags(trial.config), **told_apart},
            parent=parent,
            resume=True,
            folders=[*trial.config["paths"].values()],
            enabled=tracking["enabled"],
        )
        callbacks = Callbacks([*copy.deepcopy(self._callbacks), *callbacks_named(trial.config)])
        self._training = Training(self._make(trial.config), trial.config, trial.folder, self._run, callbacks)
        self._started = False
        with replacing(trial.folder.config) as draft:
            draft.write_text(dump(trial.config), encoding="utf-8")
        self._run.artifact(trial.folder.config)
        self._drawn = {f"setting/{key}": value for key, value in trial.drawn.items() if isinstance(value, int | float)}

    def step(self) -> dict[str, Any]:
        """Train to the next evaluation; at the budget's end leave what `train` leaves."""
        if self._refused is not None:
            if self._run is not None:
                self._run.close("FAILED")
            raise self._refused.with_traceback(None) from None
        if self._training is None:
            assert self._figures is not None
            return {**self._figures, "done": True}
        assert self._run is not None
        training = self._training
        if training.progress.env_steps == 0:  # not one that goes on from a checkpoint
            training.folder.forget_after(-1)
        try:
            training.callbacks.check()  # only now: with the last figures came a checkpoint
            if not self._started:
                training.start()
            self._started = True
            figures: dict[str, Any] = training.to_next_evaluation() or training.folder.read_evaluations()[-1]
            # Population based training changes settings on the way, which parameters cannot tell.
            self._run.metrics(self._drawn, step=training.progress.env_steps)
            figures |= {key: getattr(training.progress, key) for key in ("env_steps", "updates", "seconds")}
            if training.done():
                training.callbacks.check()
                conclude(training)
                with replacing(training.folder.path / FINISHED) as draft:
                    draft.write_text(json.dumps(figures), encoding="utf-8")
                self._run.close()
                self.lock.close()
        except Exception:
            self._run.close("FAILED")
            raise
        return {**figures, "done": training.done()}

    def save_checkpoint(self, checkpoint_dir: str) -> str:
        """Algorithm, replay buffer and progress."""
        if self._training is not None:
            checkpoint.write(self._training.algorithm, vars(self._training.progress).copy(), Path(checkpoint_dir))
            self._training.callbacks.tell("on_checkpoint", Path(checkpoint_dir))
        else:
            (Path(checkpoint_dir) / FINISHED).touch()
        return checkpoint_dir

    def load_checkpoint(self, checkpoint_dir: str) -> None:
        """Go on from what `save_checkpoint` wrote, of this trial or of another."""
        if self._training is not None and (Path(checkpoint_dir) / checkpoint.PROGRESS).is_file():
            self._training.restore(Path(checkpoint_dir))
            self._started = False

    def cleanup(self) -> None:
        """End what the trial started."""
        self._end()

    def _end(self) -> None:
        if self._training is not None:
            self._training.algorithm.stop()
        if self._run is not None:
            self._run.close()
        self._training = self._run = None
        self.lock.close()


class TrialTrainable(TrainingTrainable):
    """A trial of a study."""

    def setup(
        self,
        config: Mapping[str, Any],
        make: Callable[[Mapping[str, Any]], Algorithm] = build,
        callbacks: Sequence[Callback] = (),
        plan: Plan | None = None,
        study: str = "",
        parent: str | None = None,
    ) -> None:
        """Begin a trial.

        Args:
            config, make, callbacks: see `TrainingTrainable`.
            plan: from the configuration to the trial.
            study: its name, for the tracking store.
            parent: id of the study's run there.
        """
        assert plan is not None, "Tune gives it"
        self._plan, self._study, self._parent = plan, study, parent
        super().setup(config, make, callbacks)

    def trial(self, given: Mapping[str, Any]) -> Trial:
        """The plan's."""
        return self._plan.trial(given, self.trial_id)

    def family(self, trial: Trial) -> tuple[str | None, dict[str, str]]:
        """The study and its variant."""
        return self._parent, {"study": self._study, "variant": trial.label}


def resources(config: Mapping[str, Any]) -> tune.PlacementGroupFactory:
    """What one trial takes: a core for the training, each env runner and each remote learner, and the learners' GPUs.

    Raises:
        ConfigError: the trial asks for more GPUs than there are.
    """
    learner, runner = config["learner"], {"CPU": 1.0}
    learning = runner | ({"GPU": 1.0} if gpus_per_learner(learner["device"], learner["count"], cluster_gpus()) else {})
    learners = [runner, *[learning] * learner["count"]] if learner["count"] else [learning]
    return tune.PlacementGroupFactory([*learners, *[runner] * config["runners"]["count"]])


def _quiet() -> None:
    """Keep a trial's process to one thread, and Ray's log in it to errors."""
    import torch

    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    torch.set_num_threads(1)
    for name in ("ray", "ray.rllib", "ray.tune"):
        logging.getLogger(name).setLevel(logging.ERROR)
