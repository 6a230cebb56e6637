"""The complete tree of settings: the defaults, overlaid.

It is a plain nested dict, complete and checked: every key of the defaults is there, and every value has the type and
lies in the range that `SCHEMA` gives. Numbers may be written as ``3e-4`` or ``1.2e6``; a whole number given for a float
becomes one, and ``1.2e6`` given for an integer becomes 1200000.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from envs.plug_ins.environment_parts import PlugIns
from envs.plug_ins.lookup import is_spec
from envs.plug_ins.search_path import look_in
from envs.types import SETTINGS, MeshingParameters
from freemesh_ray.config.algorithms import ALGORITHMS, settings_by_key
from freemesh_ray.config.document import document
from freemesh_ray.config.field import ConfigError, check
from freemesh_ray.config.layer import (
    ALGORITHM,
    Entry,
    Layer,
    file_layer,
    know_algorithms,
    set_layer,
    tree_layer,
    value_layer,
)
from freemesh_ray.config.schema import SCHEMA, SHORTHANDS, algorithm_name

Scalar = str | int | float | bool | None


#: An overlay: a YAML file, or settings, nested or by dotted key.
Overlay = str | os.PathLike[str] | Mapping[str, Any]


def load(overlays: Overlay | Sequence[Overlay] = (), sets: Sequence[str] = ()) -> dict[str, Any]:
    """The defaults, overlaid by files or mappings and then by ``key=value`` strings, later ones winning.

    Args:
        overlays: one or several; a bare name without suffix (``train_smoke``) is a file that ships with the package.
        sets: ``key.sub=value``, the value in YAML.

    Returns:
        The complete tree, nested dicts of checked values, in the order of the defaults.

    Raises:
        ConfigError: an unknown or repeated key, a wrong type or range, a missing, empty or invalid file.
        PluginError: an algorithm of a user's own that cannot be had.
    """
    several = [overlays] if isinstance(overlays, str | os.PathLike | Mapping) else overlays
    read = [each if isinstance(each, Mapping) else document(os.fspath(each)) for each in several]
    look_beside([each[0] for each in read if isinstance(each, tuple)])
    for each in read:
        if isinstance(each, tuple):
            know_algorithms(each[1])
        elif isinstance(each.get(ALGORITHM), str):
            algorithm_name(each[ALGORITHM])
    know_algorithms(None, sets)
    return resolve([*map(_layer, read), *map(set_layer, sets)])


def _layer(read: Mapping[str, Any] | tuple[str, yaml.Node]) -> Layer:
    return value_layer(read, "settings") if isinstance(read, Mapping) else tree_layer(read[1], read[0], 1)


def look_beside(files: Sequence[str]) -> None:
    """Look for plug-ins in the current folder, and beside files of settings."""
    look_in(Path.cwd())
    for name in files:
        if Path(name).is_file():
            look_in(Path(name).parent)


def resolve(layers: Sequence[Layer]) -> dict[str, Any]:
    """The defaults, overlaid by layers, later ones winning: the tree as `load` returns it.

    Raises:
        ConfigError: a wrong type or range.
    """
    for layer in layers:
        for entry in layer:
            if entry.key == ALGORITHM and isinstance(entry.value, str):
                algorithm_name(entry.value)
    settings: dict[str, Any] = {key: setting.default for key, setting in settings_by_key(ALGORITHMS).items()}
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
    for small, large in dict.fromkeys((algorithm.batch, algorithm.experience) for algorithm in ALGORITHMS.values()):
        if settings[small] > settings[large]:
            last = max(small, large, key=list(places).index)
            values = f"{small} = {settings[small]} is more than {large} = {settings[large]}"
            raise ConfigError(f"{places[last]}: {values}: lower it")
    shared, learners = ALGORITHMS[algorithm_name(settings[ALGORITHM])].batch, settings["learner.count"]
    if learners and settings[shared] % learners:
        last = max(shared, "learner.count", "algorithm", key=list(places).index)
        values = f"{shared} = {settings[shared]} cannot be shared out among learner.count = {learners}"
        raise ConfigError(f"{places[last]}: {values}: use a multiple")
    return _nested({key: settings[key] for key in SCHEMA})


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
    return MeshingParameters(**{name: config["env"][name] for name in SETTINGS})


def plug_ins(config: Mapping[str, Any]) -> PlugIns:
    """What of the environment is a user's own."""
    env = config["env"]
    return PlugIns(env["reward"], env["observe"], tuple(env["wrappers"]))


def plug_ins_named(config: Mapping[str, Any]) -> list[str]:
    """All plug-ins that a tree names, each once."""
    env, evaluation = config["env"], config["evaluation"]
    named = [
        config["algorithm"], env["reward"], env["observe"], *env["wrappers"], *config["curriculum"]["stages"],
        *evaluation["metrics"], *config["callbacks"],
    ]  # fmt: skip
    return [spec for spec in dict.fromkeys(named) if is_spec(spec) and not Path(spec).is_file()]


def _checked(entry: Entry) -> Any:
    """The entry's value in its schema type."""
    return check(entry.value, SCHEMA[entry.key], entry.place, entry.key)


def _nested(flat: Mapping[str, Any]) -> dict[str, Any]:
    """Dotted keys as a tree."""
    tree: dict[str, Any] = {}
    for key, value in flat.items():
        section, _, name = key.rpartition(".")
        (tree.setdefault(section, {}) if section else tree)[name] = value
    return tree
