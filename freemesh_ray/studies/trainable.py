"""One trial as Ray Tune runs it: its trainings, evaluation by evaluation, with checkpoints that Tune keeps."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ray import tune

from envs.errors import UserError
from freemesh_ray.algorithms.build import build
from freemesh_ray.algorithms.device import cluster_gpus, gpus_per_learner
from freemesh_ray.config import store_login
from freemesh_ray.studies.plan import Plan, Trial
from freemesh_ray.studies.seed_training import SeedTraining
from freemesh_ray.training.callback import Callback
from freemesh_ray.training.loop import Algorithm


class TrainingTrainable(tune.Trainable):
    """A trial whose step is the way to its next evaluation.

    It has one training, or one of each of several seeds, which go side by side: its figures are their means.
    """

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
            callbacks: every training has copies of its own.
        """
        _quiet()
        self._make, self._callbacks = make, callbacks
        self._try_to_begin(config)

    def trainings(self, given: Mapping[str, Any]) -> Sequence[Trial]:
        """The trainings of Tune's configuration, one a seed."""
        raise NotImplementedError

    def family(self, trial: Trial) -> tuple[str | None, dict[str, str]]:
        """The id of the parent's run in the tracking store, and what trials of one parent are told apart by."""
        raise NotImplementedError

    @property
    def lengthened(self) -> bool:
        """Whether a training may go on when it was over."""
        return False

    def reset_config(self, new_config: Mapping[str, Any]) -> bool:
        """Begin another trial in this process: what is imported and compiled stays."""
        self._end()
        self._try_to_begin(new_config)
        return True

    def _try_to_begin(self, config: Mapping[str, Any]) -> None:
        """Begin a trial, or keep for its first step why it cannot: who dies in `setup` leaves pages to read."""
        self._members: list[SeedTraining] = []
        self._refused: UserError | None = None
        try:
            for trial in self.trainings(config):
                self._members.append(SeedTraining(trial, self.lengthened))
                self._members[-1].begin(self._make, self._callbacks, *self.family(trial))
        except UserError as error:
            self._refused = error

    def step(self) -> dict[str, Any]:
        """Train to the next evaluation; at the budget's end leave what `train` leaves."""
        if self._refused is not None:
            for member in self._members:
                member.fail()
            raise self._refused.with_traceback(None) from None
        return mean([member.step() for member in self._members])

    def save_checkpoint(self, checkpoint_dir: str) -> str:
        """Algorithm, replay buffer and progress of every training."""
        for member, place in self._places(checkpoint_dir):
            member.save(place)
        return checkpoint_dir

    def load_checkpoint(self, checkpoint_dir: str) -> None:
        """Go on from what `save_checkpoint` wrote, of this trial or of another."""
        for member, place in self._places(checkpoint_dir):
            member.load(place)

    def _places(self, checkpoint_dir: str) -> list[tuple[SeedTraining, Path]]:
        """Where each training has its part of a checkpoint: the folder itself where there is one training."""
        folder, several = Path(checkpoint_dir), len(self._members) > 1
        return [(member, folder / str(member.trial.seed) if several else folder) for member in self._members]

    def release(self) -> None:
        """Give back the run folders, as the kernel does for a process that is killed."""
        for member in self._members:
            member.release()

    def cleanup(self) -> None:
        """End what the trial started."""
        self._end()

    def _end(self) -> None:
        for member in self._members:
            member.end()
        self._members = []


def mean(figures: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The means of several trainings' figures; done when all are, and no further than the one behind."""
    first = dict(figures[0])
    if len(figures) == 1:
        return first
    common = [key for key in first if all(key in one for one in figures)]
    means = {key: sum(one[key] for one in figures) / len(figures) for key in common}
    steps, done = min(one["env_steps"] for one in figures), all(one["done"] for one in figures)
    return {**means, "env_steps": steps, "done": done}


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
        logins: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """Begin a trial.

        Args:
            config, make, callbacks: see `TrainingTrainable`.
            plan: from the configuration to the trial.
            study: its name, for the tracking store.
            parent: id of the study's run there.
            logins: users and passwords of stores, which the configuration does not have.
        """
        assert plan is not None, "Tune gives it"
        store_login.remember(logins)
        self._plan, self._study, self._parent = plan, study, parent
        super().setup(config, make, callbacks)

    def trainings(self, given: Mapping[str, Any]) -> Sequence[Trial]:
        """The plan's."""
        return self._plan.trainings(given, self.trial_id)

    @property
    def lengthened(self) -> bool:
        """Whether the plan's may."""
        return self._plan.lengthened

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
