"""What a study is: its YAML file, read and checked, whether it is to be run or to be reported on.

A file has two parts. ``settings`` holds what all trials share, over the defaults. ``study`` says what they differ in:
``variants`` (label -> settings), or a ``grid`` of settings, each with each of ``seeds``, some with ``more_seeds``; or a
``search`` of a space of settings, each draw with each of ``seeds``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from freemesh_ray import config
from freemesh_ray.config import ConfigError, Field, Layer
from freemesh_ray.config.paths import Paths
from freemesh_ray.policies.evaluation import METRICS, SCORE
from freemesh_ray.studies import grid
from freemesh_ray.studies.grid import LABEL
from freemesh_ray.studies.space import Space, read_space

#: What may stand between two labels of an expectation: is better than, scores the same as.
BETTER, SAME = ">", "="

#: What ``study`` may hold besides ``variants``, ``grid`` and ``search``; defaults are those of `Study`.
KEYS: dict[str, Field] = {
    "title": Field(str),
    "paper": Field(str, optional=True),
    "finding": Field(str, optional=True),
    "expects": Field(str, many=True, distinct=True),
    "seeds": Field(int, 0, 2**31 - 1, many=True, distinct=True),
    "domains": Field(str, many=True, distinct=True),
    "metric": Field(str, words=METRICS),
    "retries": Field(int, 0, 100),
}
#: What ``study.search`` may hold besides ``space`` and ``confirm``; defaults are those of `Search`.
SEARCH_KEYS: dict[str, Field] = {
    "trials": Field(int, 1, 10**6),
    "searcher": Field(str, words=("optuna", "random")),
    "scheduler": Field(str, words=("asha", "pbt", "none")),
    "grace": Field(int, 1, config.COUNT),
    "reduction": Field(float, 1.5, 100),
    "perturbation": Field(int, 1, config.COUNT),
}
#: What ``study.search.confirm`` may hold; defaults are those of `Confirm`.
CONFIRM_KEYS: dict[str, Field] = {"best": Field(int, 1, 1000), "seeds": KEYS["seeds"]}


@dataclass(frozen=True, kw_only=True)
class Confirm:
    """The best draws of a search, and its default, trained again: the best of many is the luckiest, too.

    Attributes:
        seeds: of these trainings, none of the search's own.
        best: how many draws.
    """

    seeds: Sequence[int]
    best: int = 3


@dataclass(frozen=True, kw_only=True)
class Search:
    """A search of a space of settings.

    Attributes:
        trials: how many draws, each trained with each of the study's seeds; the first has the study's own settings.
        space: dotted key -> what its values are drawn from.
        searcher: optuna (tree-structured Parzen estimator) or random.
        scheduler: asha (asynchronous successive halving), pbt (population based training) or none.
        grace: env steps before asha may stop a trial; ``reduction``: one of so many goes on at each rung.
        perturbation: env steps between two of pbt's perturbations.
        confirm: what is trained again when the search is over; None for nothing.
    """

    trials: int
    space: Mapping[str, Space]
    searcher: str = "optuna"
    scheduler: str = "asha"
    grace: int = 10_000
    reduction: float = 3.0
    perturbation: int = 10_000
    confirm: Confirm | None = None


class Expectation(NamedTuple):
    """What is expected of two variants.

    Attributes:
        x: a label.
        relation: `BETTER` or `SAME`.
        y: another label; of the same, the baseline.
    """

    x: str
    relation: str
    y: str

    def __str__(self) -> str:
        return f"{self.x} {self.relation} {self.y}"


@dataclass(frozen=True, kw_only=True)
class Study:
    """A study, checked.

    Attributes:
        name: of the file, or of the study's folder.
        title: of the report and its figure.
        settings: what all trials share.
        variants: label -> settings that differ; empty for a search.
        search: None for a study of variants.
        seeds: each variant is trained with each; none where the variants set their seeds.
        more_seeds: label -> seeds that this variant alone is trained with, too.
        metric: of an evaluation (`freemesh_ray.policies.evaluation`), the larger the better.
        expects: what is expected to come out.
        domains: what every policy is evaluated on in the report.
        retries: how often a failed trial is tried again.
        paper, finding: where the paper has it, and what it found.
        last: ``key=value`` settings, over everything.
        paths: what its trees' paths are relative to.
    """

    name: str
    title: str
    settings: Layer
    variants: Mapping[str, Layer]
    search: Search | None = None
    seeds: Sequence[int] = ()
    more_seeds: Mapping[str, Sequence[int]] = field(default_factory=dict)
    metric: str = SCORE
    expects: Sequence[Expectation] = ()
    domains: Sequence[str] = ()
    retries: int = 1
    paper: str | None = None
    finding: str | None = None
    last: Sequence[Layer] = ()
    paths: Paths = field(default_factory=Paths.from_environment)

    def seeds_of(self, label: str) -> Sequence[int]:
        """The seeds that a variant is trained with."""
        own = config.values(self.variants[label]).get("seed")
        return [*self.seeds, *self.more_seeds.get(label, [])] if own is None else [own]

    def trainings(self) -> int:
        """How many trainings there are, without those that confirm a search."""
        if self.search is not None:
            return self.search.trials * len(self.seeds)
        return sum(len(self.seeds_of(label)) for label in self.variants)

    def trial_config(self, label: str | None, seed: int, drawn: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """The complete tree of one trial.

        Args:
            label: of its variant, None for the settings that all share.
            seed: of its random numbers.
            drawn: settings that a search chose.
        """
        layers = [self.settings, *([self.variants[label]] if label is not None else []), *self.last]
        own = config.value_layer({**(drawn or {}), "seed": seed}, f"study {self.name}")
        return self._resolved([*layers, own])

    def settings_of_all(self) -> dict[str, Any]:
        """The complete tree without what trials differ in."""
        return self._resolved([self.settings, *self.last])

    def _resolved(self, layers: Sequence[Layer]) -> dict[str, Any]:
        tree = self.paths.resolved(config.resolve(layers))
        if tree["runners"]["count"] == "auto":  # trials run side by side, each on a core
            tree["runners"]["count"] = 0
        return tree

    def tree(self) -> dict[str, Any]:
        """The study as a plain tree, to be written down."""
        common = config.values([entry for layer in (self.settings, *self.last) for entry in layer])
        about: dict[str, Any] = {key: getattr(self, key) for key in KEYS}
        about |= {
            "expects": [str(expected) for expected in self.expects],
            "seeds": list(self.seeds),
            "more_seeds": {label: list(seeds) for label, seeds in self.more_seeds.items()},
            "domains": list(self.domains),
            "variants": {label: config.values(layer) for label, layer in self.variants.items()},
        }
        if self.search:
            about["search"] = {
                **{key: getattr(self.search, key) for key in SEARCH_KEYS},
                "space": {key: {space.distribution: list(space.values)} for key, space in self.search.space.items()},
            }
            if confirm := self.search.confirm:
                about["search"]["confirm"] = {"best": confirm.best, "seeds": list(confirm.seeds)}
        return {
            "study": {key: value for key, value in about.items() if value not in ([], {}, None)},
            "settings": common,
        }


def load(
    source: str | Path | Mapping[str, Any], sets: Sequence[str] = (), *, smoke: bool = False, beside: bool = True
) -> Study:
    """Read a study.

    Args:
        source: a file, the name of a study that ships with the package, or what a file would hold: the study is then
            named after its title.
        sets: ``key=value``, over the settings of all trials.
        smoke: the whole path in about a minute: the settings of ``study_smoke.yaml``, two seeds, six trials.
        beside: look for plug-ins in the current folder and beside the file, too; for files that are others' record of
            a study, only where Python looks.

    Raises:
        ConfigError: what is wrong, with file, line and fix.
        PluginError: an algorithm of a user's own cannot be had.
    """
    name, root = _written(source) if isinstance(source, Mapping) else config.document(source)
    if beside:
        config.look_beside([name])
    config.know_algorithms(root, sets)
    parts = _pairs(root, 1, name, "the file")
    for key, (_, line) in parts.items():
        if key not in ("study", "settings"):
            raise ConfigError(f"{name}:{line}: {key}: unknown part of a study: it has study and settings")
    if "study" not in parts:
        raise ConfigError(f"{name}:1: is no study: it has no part `study`; settings of one training are for --config")
    layer, line = parts.get("settings", (None, 1))
    settings = [] if layer is None else config.tree_layer(layer, name, line)
    study = _study(Path(name).stem, name, *parts["study"], settings)
    if isinstance(source, Mapping):
        study = replace(study, name=re.sub(r"[^A-Za-z0-9]+", "-", study.title).strip("-").lower() or study.name)
    return _over(study, [config.set_layer(text) for text in sets], smoke)


def _written(study: Mapping[str, Any]) -> tuple[str, yaml.Node]:
    """A study from Python, as if it were a file; lines are those of its YAML."""
    try:
        root = config.composed(config.dump(study), "study")
    except yaml.YAMLError as error:
        raise ConfigError(f"study: holds what is no text, number, list or mapping ({error.args[-1]!r:.60})") from error
    assert root is not None  # an empty mapping is written as one
    return "study", root


def shipped() -> list[str]:
    """Names of the studies that ship with the package."""
    return [name for name in config.shipped() if _is_study(name)]


def _is_study(name: str) -> bool:
    _, root = config.document(name)
    return isinstance(root, yaml.MappingNode) and any(key.value == "study" for key, _ in root.value)


def _over(study: Study, last: list[Layer], smoke: bool) -> Study:
    """The study with settings that come last."""
    varied = {entry.key for layer in study.variants.values() for entry in layer}
    varied |= set(study.search.space) if study.search else set()
    for layer in last:
        for entry in layer:
            if entry.key in varied or entry.key in ("seed", "name"):
                raise ConfigError(f"{entry.place}: {entry.key} is what the study's trials differ in: change its file")
    if smoke:
        last = [config.file_layer("study_smoke"), *last]
        study = _shrunk(study)
    study = replace(study, last=last)
    for label in study.variants:
        study.trial_config(label, study.seeds_of(label)[0])  # resolved once: what is wrong shows now
    if study.search:
        study.settings_of_all()
    return study


def _shrunk(study: Study) -> Study:
    """The same with few trials."""
    search = study.search
    if search is None:
        return replace(study, name=f"{study.name}-smoke", seeds=study.seeds[:2], more_seeds={})
    confirm = replace(search.confirm, best=1, seeds=search.confirm.seeds[:1]) if search.confirm else None
    search = replace(search, trials=min(6, search.trials), confirm=confirm)
    return replace(study, name=f"{study.name}-smoke", seeds=study.seeds[:1], search=search)


def _study(stem: str, name: str, node: yaml.Node, line: int, settings: Layer) -> Study:
    values, parts = _keys(node, name, line, "study", KEYS, "variants", "grid", "search", "more_seeds")
    variants = _variants(name, *parts["variants"]) if "variants" in parts else {}
    if "grid" in parts and not variants:
        variants = _grid(name, *parts["grid"])
    search = _search(name, *parts["search"]) if "search" in parts else None
    if "title" not in values:
        raise ConfigError(f"{name}:{line}: study.title is missing: it must be {KEYS['title']}")
    if bool(variants) == bool(search) or {"variants", "grid"} <= set(parts):
        raise ConfigError(f"{name}:{line}: study: give variants (label: settings), a grid or a search, one of them")
    seeds = values.get("seeds", [])
    if search and search.scheduler == "pbt" and len(seeds) > 1:
        raise ConfigError(f"{name}:{parts['seeds'][1]}: study.seeds: a population has one seed: write seeds: [356]")
    if search and search.confirm and (again := sorted(set(seeds) & set(search.confirm.seeds))):
        place = f"{name}:{parts['search'][1]}: study.search.confirm.seeds"
        raise ConfigError(f"{place}: {again[0]} is one of the search's own: give fresh ones")
    if "expects" in values:
        place = f"{name}:{parts['expects'][1]}"
        values["expects"] = [_expected(text, variants, place) for text in values["expects"]]
    if "more_seeds" in parts:
        values["more_seeds"] = _more_seeds(name, *parts["more_seeds"], variants, seeds)
    own = ["seed" in config.values(layer) for layer in variants.values()]
    if any(own) and (seeds or "more_seeds" in parts or not all(own)):
        raise ConfigError(f"{name}:{line}: study: either every variant sets its seed, or study.seeds does for all")
    if not any(own) and not seeds:
        raise ConfigError(f"{name}:{line}: study.seeds is missing: it must be {KEYS['seeds']}")
    return Study(name=stem, variants=variants, search=search, settings=settings, **values)


def _variants(name: str, node: yaml.Node, line: int) -> dict[str, Layer]:
    variants = {}
    for label, (settings, at) in _pairs(node, line, name, "study.variants").items():
        config.check(label, LABEL, f"{name}:{at}", "study.variants")
        variants[label] = [] if _nothing(settings) else config.tree_layer(settings, name, at)
    return variants


def _more_seeds(
    name: str, node: yaml.Node, line: int, variants: Mapping[str, Layer], seeds: Sequence[int]
) -> dict[str, list[int]]:
    """Label -> fresh seeds."""
    found = {}
    for label, (values, at) in _pairs(node, line, name, "study.more_seeds").items():
        place, key = f"{name}:{at}", f"study.more_seeds.{label}"
        if label not in variants:
            raise ConfigError(f"{place}: {key}: is no variant: known are {', '.join(variants) or 'none, in a search'}")
        found[label] = config.check(config.plain(values, place), KEYS["seeds"], place, key)
        if again := sorted(set(seeds) & set(found[label])):
            raise ConfigError(f"{place}: {key}: {again[0]} is among study.seeds: remove it here")
    return found


def _grid(name: str, node: yaml.Node, line: int) -> dict[str, Layer]:
    choices = _pairs(node, line, name, "study.grid")
    values = {
        key: grid.read_values(key, config.plain(choice, f"{name}:{at}"), f"{name}:{at}")
        for key, (choice, at) in choices.items()
    }
    return grid.variants(values, f"{name}:{line}") if values else {}


def _search(name: str, node: yaml.Node, line: int) -> Search:
    values, parts = _keys(node, name, line, "study.search", SEARCH_KEYS, "space", "confirm")
    choices = _pairs(*parts["space"], name, "study.search.space") if "space" in parts else {}
    if "trials" not in values or not choices:
        raise ConfigError(f"{name}:{line}: study.search: needs trials (how many) and space (key: {{uniform: [a, b]}})")
    space = {
        key: read_space(key, config.plain(choice, f"{name}:{at}"), f"{name}:{at}")
        for key, (choice, at) in choices.items()
    }
    confirm = _confirm(name, *parts["confirm"]) if "confirm" in parts else None
    if confirm and values.get("scheduler") == "pbt":
        at = parts["confirm"][1]
        raise ConfigError(f"{name}:{at}: study.search.confirm: a population's settings change on the way: remove it")
    return Search(space=space, confirm=confirm, **values)


def _confirm(name: str, node: yaml.Node, line: int) -> Confirm:
    values, _ = _keys(node, name, line, "study.search.confirm", CONFIRM_KEYS)
    if "seeds" not in values:
        raise ConfigError(f"{name}:{line}: study.search.confirm.seeds is missing: it must be {CONFIRM_KEYS['seeds']}")
    return Confirm(**values)


def _expected(text: str, variants: Mapping[str, Layer], place: str) -> Expectation:
    """The one way in which a text is an expectation: labels may hold = themselves."""
    ways = [
        Expectation(text[: found.start()].strip(), found[0], text[found.end() :].strip())
        for found in re.finditer(f"[{BETTER}{SAME}]", text)
    ]
    known = [way for way in ways if way.x in variants and way.y in variants and way.x != way.y]
    if not known:
        raise ConfigError(
            f"{place}: study.expects: {text!r}: write LABEL {BETTER} LABEL or LABEL {SAME} LABEL, two of "
            f"{', '.join(variants)}"
        )
    if len(known) > 1:
        raise ConfigError(f"{place}: study.expects: {text!r}: can be read in {len(known)} ways: rename a variant")
    return known[0]


#: Key -> its value and its line.
_Pairs = dict[str, tuple[yaml.Node, int]]


def _keys(
    node: yaml.Node, name: str, line: int, what: str, known: Mapping[str, Field], *nested: str
) -> tuple[dict[str, Any], _Pairs]:
    """The checked values of a mapping's ``known`` keys, and all its pairs, those of ``nested`` keys among them."""
    pairs = _pairs(node, line, name, what)
    values = {}
    for key, (child, at) in pairs.items():
        place = f"{name}:{at}"
        if key in known:
            values[key] = config.check(config.plain(child, place), known[key], place, f"{what}.{key}")
        elif key not in nested:
            raise ConfigError(f"{place}: {what}.{key}: unknown key: known are {', '.join([*known, *nested])}")
    return values, pairs


def _pairs(node: yaml.Node, line: int, name: str, what: str) -> _Pairs:
    """The pairs of a mapping, each key once."""
    if not isinstance(node, yaml.MappingNode):
        raise ConfigError(f"{name}:{line}: {what}: must be keys with values below it")
    found: _Pairs = {}
    for key, value in node.value:
        at = key.start_mark.line + 1
        if str(key.value) in found:
            raise ConfigError(f"{name}:{at}: {key.value}: already set at line {found[key.value][1]}: remove one")
        found[str(key.value)] = (value, at)
    return found


def _nothing(node: yaml.Node) -> bool:
    return not node.value or (isinstance(node, yaml.ScalarNode) and node.value in ("~", "null"))
