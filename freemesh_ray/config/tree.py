"""The complete tree of settings: the defaults, overlaid.

It is a plain nested dict, complete and checked: every key of the defaults is there, and every value has the type and
lies in the range that `SCHEMA` gives. Numbers may be written as ``3e-4`` or ``1.2e6``; a whole number given for a float
becomes one, and ``1.2e6`` given for an integer becomes 1200000.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from typing import Any

from envs.types import SETTINGS, MeshingParameters
from freemesh_ray.config.algorithms import ALGORITHMS, settings_by_key
from freemesh_ray.config.field import ConfigError, check
from freemesh_ray.config.layer import Entry, Layer, file_layer, set_layer, value_layer
from freemesh_ray.config.schema import SCHEMA, SHORTHANDS

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
    """
    several = [overlays] if isinstance(overlays, str | os.PathLike | Mapping) else overlays
    return resolve([*map(_layer, several), *map(set_layer, sets)])


def _layer(overlay: Overlay) -> Layer:
    if isinstance(overlay, Mapping):
        return value_layer(overlay, "settings")
    return file_layer(os.fspath(overlay))


def resolve(layers: Sequence[Layer]) -> dict[str, Any]:
    """The defaults, overlaid by layers, later ones winning: the tree as `load` returns it.

    Raises:
        ConfigError: a wrong type or range.
    """
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
    shared, learners = ALGORITHMS[settings["algorithm"]].batch, settings["learner.count"]
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
