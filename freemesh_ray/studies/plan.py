"""The trials of a study, and what makes two trainings one and the same.

A trial of variants has an identity: everything in its configuration that decides its result, and the source that it
runs. Trials of one identity, of whatever study, share one run folder, so that it is trained once.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any, Protocol

from envs.plug_in import digest
from freemesh_ray.config import ALGORITHMS, algorithm_name, flatten, plug_ins_named
from freemesh_ray.studies.definition import Study
from freemesh_ray.training.run_folder import RunFolder

#: Label of a search's trial that has the study's own settings.
DEFAULT = "default"
#: Settings that say where things lie, and decide nothing of what is learnt.
OUTSIDE_IDENTITY = ("name", "tracking.", "paths.", "checkpoint.")


@dataclass(frozen=True)
class Trial:
    """One training of a study.

    Attributes:
        label: of its variant; of a search the trial's id.
        seed: of its random numbers.
        config: its complete tree; ``name`` and ``paths.runs`` say where its run folder is.
        drawn: settings that a search chose.
    """

    label: str
    seed: int
    config: Mapping[str, Any]
    drawn: Mapping[str, Any]

    @property
    def name(self) -> str:
        """Unique in its study."""
        return self.label if self.drawn else f"{self.label}-{self.seed}"

    @property
    def folder(self) -> RunFolder:
        """Where its run lies."""
        return RunFolder(Path(self.config["paths"]["runs"]) / self.config["name"])


class Plan(Protocol):
    """From what Tune gives a trial to the trial."""

    def trial(self, tune_config: Mapping[str, Any], trial_id: str) -> Trial:
        """The trial of Tune's configuration and trial id."""


@dataclass(frozen=True)
class VariantPlan:
    """Every variant with every seed.

    Attributes:
        trials: by name, in order.
    """

    trials: Mapping[str, Trial]

    def trial(self, tune_config: Mapping[str, Any], trial_id: str) -> Trial:
        """The trial that is named."""
        return self.trials[tune_config["trial"]]


@dataclass(frozen=True)
class SearchPlan:
    """The trials of a search, whose settings come while it runs.

    Attributes:
        study: the search.
        folder: which receives one run folder a trial.
    """

    study: Study
    folder: Path

    def trial(self, tune_config: Mapping[str, Any], trial_id: str) -> Trial:
        """The trial of these settings, labelled by its id; the one of the study's own settings is the default."""
        assert self.study.search is not None
        drawn = {setting: tune_config[setting] for setting in self.study.search.space}
        label = DEFAULT if point(drawn) == default_point(self.study) else trial_id
        config = in_run_folder(self.study.trial_config(None, self.study.seeds[0], drawn), self.folder, trial_id)
        return Trial(label, self.study.seeds[0], config, drawn)


def point(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings by dotted key as a space's values are: lists as tuples."""
    return {key: tuple(value) if isinstance(value, list) else value for key, value in settings.items()}


def default_point(study: Study) -> dict[str, Any]:
    """The study's own settings as a point of its space."""
    assert study.search is not None
    tree = study.settings_of_all()
    return point({key: reduce(getitem, key.split("."), tree) for key in study.search.space})


def variant_plan(study: Study, source: str) -> VariantPlan:
    """The trials of a study of variants.

    Args:
        study: it.
        source: what runs: the commit, with a digest of what was changed since.
    """
    found: dict[str, Trial] = {}
    for label in study.variants:
        for seed in study.seeds_of(label):
            tree = study.trial_config(label, seed)
            config = in_run_folder(tree, Path(tree["paths"]["runs"]), identity(tree, source))
            trial = Trial(label, seed, config, {})
            found[trial.name] = trial
    return VariantPlan(found)


def identity(config: Mapping[str, Any], source: str) -> str:
    """Twelve hexadecimal digits that trainings with the same result have in common; plug-ins are source, too.

    Raises:
        PluginError: one cannot be found.
    """
    others = tuple(f"{name}." for name in ALGORITHMS if name != algorithm_name(config["algorithm"]))
    deciding = {key: value for key, value in flatten(config).items() if not key.startswith(OUTSIDE_IDENTITY + others)}
    own = plug_ins_named(config)
    sources = [source, *([digest(own)] if own else [])]
    return hashlib.sha256(json.dumps([deciding, *sources], sort_keys=True).encode()).hexdigest()[:12]


def in_run_folder(config: Mapping[str, Any], runs: Path, trial_id: str) -> dict[str, Any]:
    """The tree with its run folder at ``runs``/trial-ID."""
    return {**config, "name": f"trial-{trial_id}", "paths": {**config["paths"], "runs": str(runs)}}
