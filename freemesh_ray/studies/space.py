"""What a search draws one setting from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from freemesh_ray import config
from freemesh_ray.config import ConfigError

Kind = Literal["uniform", "log", "choice"]
KINDS: tuple[Kind, ...] = ("uniform", "log", "choice")


@dataclass(frozen=True)
class Space:
    """A distribution over a setting's values.

    Attributes:
        kind: uniform between two numbers, uniform in the logarithm, or one of a list.
        values: the two ends, or the list.
    """

    kind: Kind
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
    if not isinstance(value, dict) or len(value) != 1 or next(iter(value)) not in KINDS:
        raise ConfigError(f"{place}: study.search.space.{key}: {form}")
    kind, values = next(iter(value.items()))
    if not isinstance(values, list) or not values or (kind != "choice" and len(values) != 2):
        raise ConfigError(f"{place}: study.search.space.{key}: {form}")
    checked = [config.check(item, config.SCHEMA[key], place, key) for item in values]
    numbers = all(isinstance(item, int | float) and not isinstance(item, bool) for item in checked)
    if kind != "choice" and not (numbers and checked[0] < checked[1] and math.isfinite(checked[1])):
        raise ConfigError(f"{place}: study.search.space.{key}: needs two numbers, the lower one first")
    if kind == "log" and checked[0] <= 0:
        raise ConfigError(f"{place}: study.search.space.{key}: log needs numbers above 0")
    if kind != "choice" and config.SCHEMA[key].kind is int:
        raise ConfigError(f"{place}: study.search.space.{key}: takes whole numbers: list them with choice")
    return Space(kind, tuple(tuple(item) if isinstance(item, list) else item for item in checked))
