"""A training as a Tune class: ``tune.Tuner(freemesh_ray.trainable, param_space={"learner.gamma": ...})``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ray import tune

from envs.errors import PluginError
from freemesh_ray.algorithms.build import build
from freemesh_ray.config import ConfigError, load
from freemesh_ray.config.paths import Paths
from freemesh_ray.storage.lock import held
from freemesh_ray.studies.plan import Trial
from freemesh_ray.studies.trainable import TrainingTrainable, resources
from freemesh_ray.tracking import MLflowRun
from freemesh_ray.tracking.journal import journals
from freemesh_ray.training.callback import Callback
from freemesh_ray.training.job import check_plug_ins, check_stages
from freemesh_ray.training.run_folder import RunFolder


@dataclass(frozen=True)
class TuneTrial(Trial):
    """A trial whose files lie in the folder that Tune keeps for it.

    Attributes:
        place: that folder.
    """

    place: Path

    @property
    def folder(self) -> RunFolder:
        """Where its run lies."""
        return RunFolder(self.place)


class MeshTrainable(TrainingTrainable):
    """A training whose configuration is settings over the defaults, nested or by dotted key.

    A result is reported after every evaluation: its figures, ``env_steps``, ``updates`` and ``seconds``; Tune keeps a
    checkpoint where ``CheckpointConfig(checkpoint_frequency=1)`` says so. The trial's folder is the run's, too:
    ``policy.npz``, ``evaluations.jsonl`` and, at the budget's end, ``meshes``. Relative ``paths`` and the tracking
    store are relative to ``FREEMESH_HOME``, else to the experiment's ``storage_path``. In the store the trials are
    children of one run, named after the experiment.
    """

    @classmethod
    def default_resource_request(cls, config: dict[str, Any]) -> tune.PlacementGroupFactory | None:
        """What a trial takes; of a configuration that is refused a core, in which it says why."""
        try:
            return resources(_tree(config))
        except (ConfigError, PluginError):
            return None

    def setup(self, config: Mapping[str, Any], callbacks: Sequence[Callback] = ()) -> None:  # type: ignore[override]
        """Begin a trial.

        Args:
            config: as Tune gives it.
            callbacks: by ``tune.with_parameters(freemesh_ray.trainable, callbacks=[...])``; trials have copies.

        Raises:
            ConfigError, DomainError: what is wrong with the configuration.
        """
        super().setup(config, build, callbacks)

    def trainings(self, given: Mapping[str, Any]) -> Sequence[TuneTrial]:
        """The settings' training."""
        storage = self._storage
        if storage.storage_filesystem.type_name != "local":
            raise ConfigError(f"storage_path: {storage.storage_fs_path}: must be a folder: mount the bucket")
        config = _tree(given, storage.storage_fs_path)
        check_stages(config)
        check_plug_ins(config)
        config |= {"name": f"trial-{self.trial_id}", "paths": {**config["paths"], "runs": storage.experiment_fs_path}}
        return [TuneTrial(self.trial_name, config["seed"], config, dict(given), Path(storage.trial_fs_path))]

    def family(self, trial: Trial) -> tuple[str | None, dict[str, str]]:
        """The experiment: its run is made by the first trial."""
        folder, tracking = Path(self._storage.experiment_fs_path), trial.config["tracking"]
        of_all = {"study": folder.name}
        if not tracking["enabled"]:
            return None, of_all
        with held(folder, "wait", patience=math.inf):
            if found := journals(folder):
                return found[0].stem, of_all
            with MLflowRun(
                folder,
                uri=tracking["uri"],
                experiment=tracking["experiment"],
                name=folder.name,
                tags=of_all,
                folders=[folder],
            ) as parent:
                return parent.id, of_all


def _tree(given: Mapping[str, Any], home: str = "") -> dict[str, Any]:
    """The complete tree of Tune's configuration; trials sample in their own processes unless they are told otherwise.

    Raises:
        ConfigError: a setting that cannot be used.
    """
    return Paths.from_environment(home).resolved(load([{"runners.count": 0}, given]))
