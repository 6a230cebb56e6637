"""One tree of settings: ``defaults.yaml``, then overlays, then ``key=value``; what is wrong says where and why.

The tree that `load` returns is a plain nested dict, complete and checked: every key of the defaults is there, and every
value has the type and lies in the range that `SCHEMA` gives. Numbers may be written as ``3e-4`` or ``1.2e6``; a whole
number given for a float becomes one, and ``1.2e6`` given for an integer becomes 1200000.
"""

from __future__ import annotations

import difflib
import json
import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from importlib import resources
from pathlib import Path
from typing import Any

import yaml

from envs.types import DENSITIES, OBSERVATIONS, RADII, MeshingParameters

Scalar = str | int | float | bool | None


class ConfigError(ValueError):
    """A setting that cannot be used; one line with the place, the key, what is wrong and the fix."""


@dataclass(frozen=True)
class Field:
    """What one key accepts.

    Attributes:
        kind: the value's type; with ``many``, each item's.
        low, high: inclusive range of numbers.
        words: texts that are accepted; for a number, in its place. Empty: any text that is not blank.
        optional: whether null is accepted.
        many: a list of one or more values in place of one; with ``distinct``, none of them twice.
        pattern: what a text must match as a whole, with ``hint`` saying it in words.
    """

    kind: type
    low: float = -math.inf
    high: float = math.inf
    words: tuple[str, ...] = ()
    optional: bool = False
    many: bool = False
    distinct: bool = False
    pattern: str = r"(?s).*\S.*"
    hint: str = "text"

    def __str__(self) -> str:
        """What is accepted, in words: the part of a message that tells the fix."""
        span = "" if math.isinf(self.low) else f" in [{self.low:.12g}, {self.high:.12g}]"
        plain = {bool: "true or false", int: f"a whole number{span}", float: f"a number{span}", str: self.hint}
        choices = ([] if self.kind is str and self.words else [plain[self.kind]]) + list(self.words)
        one = " or ".join([*choices, *(["null"] if self.optional else [])])
        return f"a list of one or more{' different values' if self.distinct else ''}, each {one}" if self.many else one


TINY = 1e-9
COUNT = 10**12

#: Dotted key -> what it accepts. ``defaults.yaml`` holds the same keys, with their meaning and default.
SCHEMA: dict[str, Field] = {
    "name": Field(str, pattern=r"[A-Za-z0-9._-]*[A-Za-z0-9_-]", hint="text of letters, digits and . _ -"),
    "seed": Field(int, 0, 2**31 - 1),
    "algorithm": Field(str, words=("sac", "td3", "ddpg", "ppo")),
    "env.observation": Field(str, words=tuple(OBSERVATIONS), optional=True),
    "env.radius": Field(str, words=tuple(RADII), optional=True),
    "env.n": Field(int, 1, 8),
    "env.g": Field(int, 1, 16),
    "env.beta": Field(float, 1e-3, 1e3),
    "env.n_rv": Field(int, 1, 8),
    "env.alpha": Field(float, 1e-3, 1e3),
    "env.upsilon": Field(float, TINY, 10),
    "env.kappa": Field(float, TINY, 1e9),
    "env.density": Field(str, words=DENSITIES),
    "env.M_angle": Field(float, TINY, math.pi),
    "env.extended": Field(bool),
    "env.irregular": Field(float, 0, 10),
    "env.type2": Field(bool),
    "env.max_invalid": Field(int, 1, 10**9),
    "env.max_elements": Field(int, 1, COUNT, optional=True),
    "curriculum.stages": Field(str, many=True, distinct=True),
    "curriculum.promote_at": Field(float, TINY, 1),
    "curriculum.window": Field(int, 1, 10**6),
    "curriculum.max_stage_steps": Field(int, 1, COUNT),
    "curriculum.rehearsal": Field(float, 0, 0.99),
    "learner.buffer_size": Field(int, 1, 10**9),
    "learner.batch_size": Field(int, 1, 10**6),
    "learner.gamma": Field(float, 0, 1),
    "learner.learning_rate": Field(float, TINY, 1),
    "learner.tau": Field(float, TINY, 1),
    "learner.updates_per_step": Field(float, TINY, 100),
    "learner.hidden": Field(int, 1, 65536, many=True),
    "learner.warmup_steps": Field(int, 1, 10**9),
    "sac.target_entropy": Field(float, -1000, 1000, words=("auto",)),
    "sac.initial_alpha": Field(float, TINY, 1000),
    "td3.exploration_noise": Field(float, 0, 1),
    "td3.target_noise": Field(float, 0, 2),
    "td3.target_noise_clip": Field(float, 0, 2),
    "td3.policy_delay": Field(int, 1, 1000),
    "ddpg.exploration_noise": Field(float, 0, 1),
    "ppo.rollout_steps": Field(int, 1, 10**7),
    "ppo.epochs": Field(int, 1, 1000),
    "ppo.minibatch_size": Field(int, 1, 10**7),
    "ppo.clip": Field(float, TINY, 1),
    "ppo.gae_lambda": Field(float, 0, 1),
    "ppo.entropy_coefficient": Field(float, 0, 100),
    "ppo.value_coefficient": Field(float, 0, 100),
    "ppo.max_grad_norm": Field(float, TINY, 10**9),
    "runners.count": Field(int, 0, 1024),
    "runners.envs_per_runner": Field(int, 1, 4096),
    "runners.fragment": Field(int, 1, 10**5),
    "budget.env_steps": Field(int, 1, COUNT),
    "budget.minutes": Field(float, TINY, 10**9, optional=True),
    "evaluation.interval": Field(int, 1, COUNT),
    "evaluation.episodes": Field(int, 1, 10**6),
    "checkpoint.interval": Field(int, 1, COUNT),
    "checkpoint.keep": Field(int, 1, 1000),
    "tracking.uri": Field(
        str, pattern=r"sqlite:///(?!:memory:).+|https?://.+", hint="sqlite:///FILE or http://HOST:PORT"
    ),
    "tracking.experiment": Field(str),
    "tracking.enabled": Field(bool),
    "paths.runs": Field(str),
    "paths.studies": Field(str),
}  # fmt: skip

#: Keys that stand for several: name -> the keys it sets. They act where they are written, so that a later layer, or a
#: key beside them in the same file, still has its way; the loaded tree names the one that holds in the end, or null.
SHORTHANDS: dict[str, dict[str, dict[str, float]]] = {
    "env.observation": {
        name: {f"env.{key}": value for key, value in values.items()} for name, values in OBSERVATIONS.items()
    },
    "env.radius": {name: {"env.alpha": value} for name, value in RADII.items()},
}

#: (smaller, larger): the first key's value is at most the second's.
AT_MOST: tuple[tuple[str, str], ...] = (
    ("learner.batch_size", "learner.buffer_size"),
    ("ppo.minibatch_size", "ppo.rollout_steps"),
)

SECTIONS = tuple(dict.fromkeys(key.split(".")[0] for key in SCHEMA if "." in key))


class _Numbers:
    """YAML 1.1 reads 3e-4 and 1e6 as text; here they are numbers, on the way in and on the way out."""

    TAG = "tag:yaml.org,2002:float"
    FORM = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+\Z")
    FIRST = tuple("-+.0123456789")


class _Loader(yaml.SafeLoader):
    pass


class _Dumper(yaml.SafeDumper):
    pass


_Loader.add_implicit_resolver(_Numbers.TAG, _Numbers.FORM, _Numbers.FIRST)
_Dumper.add_implicit_resolver(_Numbers.TAG, _Numbers.FORM, _Numbers.FIRST)


@dataclass(frozen=True)
class _Entry:
    """One setting as written: its dotted key, its value and the place, for messages."""

    key: str
    value: Any
    place: str


#: The settings of one file, one part of a file or one ``--set``; made by `file_layer`, `set_layer` and `tree_layer`.
Layer = Sequence[_Entry]


def load(overlays: Sequence[str | Path] = (), sets: Sequence[str] = ()) -> dict[str, Any]:
    """The defaults, overlaid by files and then by ``key=value`` strings, later ones winning.

    Args:
        overlays: YAML files; a bare name without suffix (``train_smoke``) is one that ships with the package.
        sets: ``key.sub=value``, the value in YAML.

    Returns:
        The complete tree, nested dicts of checked values, in the order of the defaults.

    Raises:
        ConfigError: an unknown or repeated key, a wrong type or range, a missing, empty or invalid file.
    """
    return resolve([*map(file_layer, overlays), *map(set_layer, sets)])


def resolve(layers: Sequence[Layer]) -> dict[str, Any]:
    """The defaults, overlaid by layers, later ones winning: the tree as `load` returns it.

    Raises:
        ConfigError: a wrong type or range.
    """
    settings: dict[str, Any] = {}
    places: dict[str, str] = {}  # where each key was set last
    for layer in (file_layer("defaults"), *layers):
        checked = [(entry, _checked(entry)) for entry in layer]
        for entry, value in sorted(checked, key=lambda pair: pair[0].key not in SHORTHANDS):
            settings[entry.key] = value
            if entry.key in SHORTHANDS and value is not None:
                settings |= SHORTHANDS[entry.key][value]
            places.pop(entry.key, None)  # keeps the order of the places that of the last settings
            places[entry.key] = entry.place
    for key, names in SHORTHANDS.items():
        settings[key] = next((name for name, sets_ in names.items() if sets_.items() <= settings.items()), None)
    for small, large in AT_MOST:
        if settings[small] > settings[large]:
            last = max(small, large, key=list(places).index)
            values = f"{small} = {settings[small]} is more than {large} = {settings[large]}"
            raise ConfigError(f"{places[last]}: {values}: lower it")
    return _nested({key: settings[key] for key in SCHEMA})


def value_layer(values: Mapping[str, Any], place: str) -> Layer:
    """Settings by dotted key, as an overlay; ``place`` is where they come from, for messages.

    Raises:
        ConfigError: an unknown key.
    """
    for key in values:
        if key not in SCHEMA:
            raise ConfigError(f"{place}: {key}: unknown key{_nearest(key)}")
    return [_Entry(key, value, place) for key, value in values.items()]


def values(layer: Layer) -> dict[str, Any]:
    """What an overlay sets, by dotted key, as written."""
    return {entry.key: entry.value for entry in layer}


def dump(config: Mapping[str, Any]) -> str:
    """The tree as YAML that `load` reads back to the same tree."""
    return yaml.dump(dict(config), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120)


def flatten(config: Mapping[str, Any]) -> dict[str, Scalar]:
    """Dotted key -> scalar, lists as JSON text: what an experiment tracker takes as parameters."""
    flat: dict[str, Scalar] = {}
    for key, value in config.items():
        if isinstance(value, Mapping):
            flat |= {f"{key}.{sub}": item for sub, item in flatten(value).items()}
        else:
            flat[key] = json.dumps(value) if isinstance(value, list) else value
    return flat


def meshing_parameters(config: Mapping[str, Any]) -> MeshingParameters:
    """The ``env`` section as the environment takes it."""
    return MeshingParameters(**{field.name: config["env"][field.name] for field in fields(MeshingParameters)})


def shipped() -> list[str]:
    """Names of the configurations that ship with the package, without suffix."""
    return sorted(item.name.removesuffix(".yaml") for item in _folder().iterdir() if item.name.endswith(".yaml"))


def _folder() -> Any:
    return resources.files("tune_configs")


def file_layer(source: str | Path) -> Layer:
    """The settings of one YAML file, as an overlay."""
    name, root = document(source)
    return tree_layer(root, name, 1)


def document(source: str | Path) -> tuple[str, yaml.Node]:
    """A YAML file's name and its tree; a bare name without suffix is a file that ships with the package.

    Raises:
        ConfigError: a missing, empty or invalid file.
    """
    name = str(source)
    short = name.removesuffix(".yaml")
    bare = "/" not in name and not os.path.isfile(name) and (short in shipped() or not Path(name).suffix)
    if bare and short not in shipped():
        raise ConfigError(
            f"{name}: no such configuration: use a path ending in .yaml, or one of {', '.join(shipped())}"
        )
    try:
        text = (_folder() / f"{short}.yaml" if bare else Path(name)).read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{name}: cannot be read ({error.strerror}): check the path") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{name}: is not UTF-8 text: save it as UTF-8") from error
    root = _composed(text, name)
    if root is None:
        raise ConfigError(f"{name}:1: is empty: list the keys that differ from the defaults, or leave the file out")
    return name, root


def tree_layer(node: yaml.Node, name: str, line: int) -> Layer:
    """The settings of a YAML tree that begins on ``line`` of file ``name``, as an overlay.

    Raises:
        ConfigError: an unknown or repeated key.
    """
    return _unique(_entries(node, "", name, line))


def set_layer(text: str) -> Layer:
    """The settings of one ``key=value`` string, as an overlay."""
    key, equals, value = text.partition("=")
    place = f"--set {text}"
    if not equals or not key.strip():
        raise ConfigError(f"{place}: is not key=value: write for example learner.gamma=0.95")
    return _unique(_entries(_composed(value, place) or yaml.ScalarNode(_NULL, ""), key.strip(), place, line=None))


_NULL = "tag:yaml.org,2002:null"


def _composed(text: str, place: str) -> yaml.Node | None:
    """The YAML tree of ``text`` with its line numbers; None when it holds nothing."""
    try:
        return yaml.compose(text, Loader=_Loader)
    except (yaml.YAMLError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark and not place.startswith("--set") else ""
        problem = getattr(error, "problem", None) or type(error).__name__
        raise ConfigError(f"{place}{line}: is not valid YAML: {problem}") from error


def _entries(node: yaml.Node, key: str, place: str, line: int | None) -> Iterator[_Entry]:
    """Every setting below ``node``, which is what stands at ``key`` ("" at the root), on ``line`` of a file."""
    here = place if line is None else f"{place}:{line}"
    if key in SCHEMA:
        yield _Entry(key, _value(node, key, here), here)
    elif key and key not in SECTIONS:
        raise ConfigError(f"{here}: {key}: unknown key{_nearest(key)}")
    elif isinstance(node, yaml.MappingNode):
        for name, child in node.value:
            below = None if line is None else name.start_mark.line + 1
            yield from _entries(child, f"{key}.{name.value}" if key else str(name.value), place, below)
    elif not (key and node.tag == _NULL):  # a section with everything in it commented out is no mistake
        what = f"{key}: is a section" if key else "the file is a list or a scalar"
        raise ConfigError(f"{here}: {what}: write keys below it, for example {_example(key)}")


def plain(node: yaml.Node, place: str) -> Any:
    """The Python value of a node.

    Raises:
        ConfigError: it has none.
    """
    try:
        return _Loader("").construct_object(node, deep=True)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ConfigError(f"{place}: has no value: {str(error).splitlines()[0]}") from error


def _value(node: yaml.Node, key: str, place: str) -> Any:
    """The Python value of a node that stands at a key of the schema."""
    try:
        return _Loader("").construct_object(node, deep=True)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ConfigError(f"{place}: {key}: must be {SCHEMA[key]}") from error


def _unique(entries: Iterator[_Entry]) -> list[_Entry]:
    """The entries of one layer, each key once."""
    found: dict[str, _Entry] = {}
    for entry in entries:
        if entry.key in found:
            raise ConfigError(f"{entry.place}: {entry.key}: already set at {found[entry.key].place}: remove one")
        found[entry.key] = entry
    return list(found.values())


def _nearest(key: str) -> str:
    """The known key that was probably meant, as the end of a message."""
    known = [*SCHEMA, *SECTIONS]
    last = key.rpartition(".")[2]
    found = (
        difflib.get_close_matches(key, known, n=1, cutoff=0.75)
        or [name for name in SCHEMA if difflib.get_close_matches(last, [name.rpartition(".")[2]], cutoff=0.75)]
        or difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    )
    return f": did you mean {found[0]}?" if found else f": known are name, seed, algorithm and {', '.join(SECTIONS)}"


def _example(key: str) -> str:
    """A line that would be right in section ``key``."""
    return next(known for known in SCHEMA if known.startswith(f"{key}." if key else "learner.")) + ": ..."


def _checked(entry: _Entry) -> Any:
    """The entry's value in its schema type."""
    return check(entry.value, SCHEMA[entry.key], entry.place, entry.key)


def check(value: Any, field: Field, place: str, key: str) -> Any:
    """The value as ``field`` takes it.

    Raises:
        ConfigError: the value is of another type or out of range.
    """
    try:
        if value is None and field.optional:
            return None
        if not field.many:
            return _fitted(value, field)
        if isinstance(value, list) and value:
            items = [_fitted(item, field) for item in value]
            if not field.distinct or len(set(items)) == len(items):
                return items
    except (ValueError, OverflowError):
        pass
    quote = ": put it in quotes" if field.kind is str and isinstance(value, int | float) else ""
    raise ConfigError(f"{place}: {key}: must be {field}, not {_shown(value)}{quote}")


def _fitted(value: Any, field: Field) -> Any:
    """One value in the field's type; ValueError or OverflowError when it does not fit."""
    if isinstance(value, str):
        fits = value in field.words if field.words else field.kind is str and re.fullmatch(field.pattern, value)
    elif isinstance(value, bool) or not isinstance(value, int | float):
        fits = isinstance(value, bool) and field.kind is bool
    else:
        fits = field.kind in (int, float) and field.low <= value <= field.high and field.kind(value) == value
        value = field.kind(value) if fits else value
    if not fits:
        raise ValueError(value)
    return value


def _shown(value: Any) -> str:
    """A value as one short piece of a message line."""
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= 60 else text[:57] + "..."


def _nested(flat: Mapping[str, Any]) -> dict[str, Any]:
    """Dotted keys as a tree."""
    tree: dict[str, Any] = {}
    for key, value in flat.items():
        section, _, name = key.rpartition(".")
        (tree.setdefault(section, {}) if section else tree)[name] = value
    return tree
