"""The trials of a study, and what makes two trainings one and the same.

A trial of variants has an identity: everything in its configuration that decides its result, the files that it names,
and the source that training depends on. Trials of one identity and length, of whatever study, share one run folder, so
that it is trained once; a longer one goes on from where a shorter one ended.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any, ClassVar, Protocol

from envs.plug_ins.source_files import digest
from freemesh_ray.config import ALGORITHMS, algorithm_name, flatten, plug_ins_named
from freemesh_ray.studies.definition import Study
from freemesh_ray.studies.label import file_name, short_label
from freemesh_ray.training.run_folder import RunFolder

#: Label of a search's trial that has the study's own settings.
DEFAULT = "default"
#: Settings that say where things lie, and decide nothing of what is learnt.
OUTSIDE_IDENTITY = ("name", "tracking.", "paths.", "checkpoint.")
#: How long it is learnt: a longer training is a shorter one that goes on.
LENGTH = "budget.env_steps"


@dataclass(frozen=True)
class Trial:
    """One training of a study.

    Attributes:
        label: of its variant; of a search what was drawn.
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
        return f"{self.label}-{self.seed}"

    @property
    def folder(self) -> RunFolder:
        """Where its run lies."""
        return RunFolder(Path(self.config["paths"]["runs"]) / self.config["name"])


class Plan(Protocol):
    """From what Tune gives a trial to its trainings.

    Attributes:
        lengthened: whether a training may go on when it was over, so that its last checkpoint is kept.
    """

    lengthened: ClassVar[bool]

    def trainings(self, tune_config: Mapping[str, Any], trial_id: str) -> Sequence[Trial]:
        """Those of Tune's configuration and trial id, one a seed; they are trained side by side."""


@dataclass(frozen=True)
class VariantPlan:
    """Every variant with every seed.

    Attributes:
        trials: by name, in order.
    """

    trials: Mapping[str, Trial]
    lengthened: ClassVar[bool] = True

    def trainings(self, tune_config: Mapping[str, Any], trial_id: str) -> Sequence[Trial]:
        """The trial that is named."""
        return [self.trials[tune_config["trial"]]]


@dataclass(frozen=True)
class SearchPlan:
    """The trials of a search, whose settings come while it runs.

    Attributes:
        study: the search.
        folder: which receives one run folder a trial.
    """

    study: Study
    folder: Path
    lengthened: ClassVar[bool] = False

    def trainings(self, tune_config: Mapping[str, Any], trial_id: str) -> Sequence[Trial]:
        """Those of the settings that were drawn, one a seed; the study's own settings are the default."""
        assert self.study.search is not None
        drawn = {setting: tune_config[setting] for setting in self.study.search.space}
        text = self._text(drawn, trial_id)
        label = text if text == DEFAULT else f"{text} ({trial_id[-4:]})"
        place = file_name(f"{text} {trial_id}")
        found = []
        for seed in self.study.seeds:
            tree = self.study.trial_config(None, seed, drawn)
            found.append(Trial(label, seed, in_run_folder(tree, self.folder, f"{place}-{seed}"), drawn))
        return found

    def _text(self, drawn: Mapping[str, Any], trial_id: str) -> str:
        """What was drawn; of a population, whose settings change on the way, nothing of it."""
        assert self.study.search is not None
        if self.study.search.scheduler == "pbt":
            return DEFAULT if trial_id.endswith("_00000") else "member"
        return DEFAULT if point(drawn) == default_point(self.study) else short_label(drawn)


def point(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings by dotted key as a space's values are: lists as tuples."""
    return {key: tuple(value) if isinstance(value, list) else value for key, value in settings.items()}


def default_point(study: Study) -> dict[str, Any]:
    """The study's own settings as a point of its space."""
    assert study.search is not None
    tree = study.settings_of_all()
    return point({key: reduce(getitem, key.split("."), tree) for key in study.search.space})


def variant_plan(study: Study, source: Mapping[str, str]) -> VariantPlan:
    """The trials of a study of variants.

    Args:
        study: it.
        source: what training runs (`freemesh_ray.studies.training_source`).
    """
    found: dict[str, Trial] = {}
    for label in study.variants:
        for seed in study.seeds_of(label):
            trial = Trial(label, seed, placed(study.trial_config(label, seed), source), {})
            found[trial.name] = trial
    return VariantPlan(found)


def placed(config: Mapping[str, Any], source: Mapping[str, str]) -> dict[str, Any]:
    """The tree with the run folder that trainings of its identity and length share."""
    name = f"{identity(config, source)}-{config['budget']['env_steps']}"
    return in_run_folder(config, Path(config["paths"]["runs"]), name)


def lineage(run: str | Path) -> str:
    """What the names of the run folders of one training's lengths have in common."""
    return Path(run).name.rpartition("-")[0]


def identity(config: Mapping[str, Any], source: Mapping[str, str]) -> str:
    """Twelve hexadecimal digits that trainings which learn the same have in common, however long they are.

    Settings count, and what they name: plug-ins and files of domains.

    Raises:
        PluginError: one cannot be found.
    """
    others = tuple(f"{name}." for name in ALGORITHMS if name != algorithm_name(config["algorithm"]))
    outside = (*OUTSIDE_IDENTITY, *others)
    deciding = {key: value for key, value in flatten(config).items() if not key.startswith(outside) and key != LENGTH}
    own = plug_ins_named(config)
    files = [path for stage in config["curriculum"]["stages"] if (path := Path(stage)).is_file()]
    contents = [hashlib.sha256(path.read_bytes()).hexdigest() for path in files]
    named = [*([digest(own)] if own else []), *contents]
    return hashlib.sha256(json.dumps([deciding, dict(source), named], sort_keys=True).encode()).hexdigest()[:12]


def in_run_folder(config: Mapping[str, Any], runs: Path, trial_id: str) -> dict[str, Any]:
    """The tree with its run folder at ``runs``/trial-ID."""
    return {**config, "name": f"trial-{trial_id}", "paths": {**config["paths"], "runs": str(runs)}}
