"""A grid: every combination of some settings' values, as the variants of a study."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

from freemesh_ray import config
from freemesh_ray.config import ConfigError, Field, Layer
from freemesh_ray.studies.label import label

#: Of a variant.
LABEL = Field(str, pattern=r"[\w.+=, -]{1,60}", hint="up to 60 letters, digits, spaces and . + = , _ -")


def read_values(key: str, values: Any, place: str) -> list[Any]:
    """The values of one setting of a grid.

    Raises:
        ConfigError: an unknown setting, or values that are no list of different ones that the setting accepts.
    """
    config.value_layer({key: None}, place)  # refuses unknown keys
    if key in ("seed", "name"):
        raise ConfigError(f"{place}: study.grid.{key}: is not varied: write study.seeds")
    if not isinstance(values, list) or not values:
        raise ConfigError(f"{place}: study.grid.{key}: write a list of values, as [0.9, 0.99]")
    checked = [config.check(value, config.SCHEMA[key], place, key) for value in values]
    if any(value in checked[:i] for i, value in enumerate(checked)):
        raise ConfigError(f"{place}: study.grid.{key}: has a value twice: remove one")
    return checked


def variants(grid: Mapping[str, Sequence[Any]], place: str) -> dict[str, Layer]:
    """Label -> settings of every combination, the last setting varying first.

    Raises:
        ConfigError: labels would be too long, or two of them the same.
    """
    found: dict[str, Layer] = {}
    for values in product(*grid.values()):
        settings = dict(zip(grid, values, strict=True))
        name = label(settings)
        if name in found or not re.fullmatch(LABEL.pattern, name):
            why = "two combinations have this label" if name in found else "is no label"
            raise ConfigError(f"{place}: study.grid: {name!r}: {why}: write variants, with labels of your own")
        found[name] = config.value_layer(settings, place)
    return found
