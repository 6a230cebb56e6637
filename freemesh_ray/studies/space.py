"""What a search draws one setting from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from freemesh_ray import config
from freemesh_ray.config import ConfigError

Distribution = Literal["uniform", "log", "choice"]
DISTRIBUTIONS: tuple[Distribution, ...] = ("uniform", "log", "choice")


@dataclass(frozen=True)
class Space:
    """A distribution over a setting's values.

    Attributes:
        distribution: uniform between two numbers, uniform in the logarithm, or one of a list.
        values: the two ends, or the list.
    """

    distribution: Distribution
    values: tuple[Any, ...]

    def nearest(self, value: float) -> float:
        """``value``, or the end that it lies beyond; of a distribution between two ends."""
        low, high = self.values
        return float(min(max(value, low), high))


def read_space(key: str, value: Any, place: str) -> Space:
    """``{uniform: [a, b]}``, ``{log: [a, b]}`` or ``{choice: [a, b, ..]}`` for a setting.

    Raises:
        ConfigError: an unknown setting, another form, or values that the setting does not accept.
    """
    form = "write {uniform: [low, high]}, {log: [low, high]} or {choice: [a, b, ..]}"
    config.value_layer({key: None}, place)  # refuses unknown keys
    if not isinstance(value, dict) or len(value) != 1 or next(iter(value)) not in DISTRIBUTIONS:
        raise ConfigError(f"{place}: study.search.space.{key}: {form}")
    distribution, values = next(iter(value.items()))
    if not isinstance(values, list) or not values or (distribution != "choice" and len(values) != 2):
        raise ConfigError(f"{place}: study.search.space.{key}: {form}")
    checked = [config.check(item, config.SCHEMA[key], place, key) for item in values]
    numbers = all(isinstance(item, int | float) and not isinstance(item, bool) for item in checked)
    if distribution != "choice" and not (numbers and checked[0] < checked[1] and math.isfinite(checked[1])):
        raise ConfigError(f"{place}: study.search.space.{key}: needs two numbers, the lower one first")
    if distribution == "log" and checked[0] <= 0:
        raise ConfigError(f"{place}: study.search.space.{key}: log needs numbers above 0")
    if distribution != "choice" and config.SCHEMA[key].kind is int:
        raise ConfigError(f"{place}: study.search.space.{key}: takes whole numbers: list them with choice")
    return Space(distribution, tuple(tuple(item) if isinstance(item, list) else item for item in checked))
