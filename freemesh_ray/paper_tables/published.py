"""The paper's printed figures, out of the one file that holds them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Any

import yaml

from envs.types import Floats


@cache
def published(table: str) -> dict[str, Any]:
    """What the paper prints of one table: scalability, generalisation, quality, observation or density."""
    return yaml.safe_load(files(__package__).joinpath("published.yaml").read_text(encoding="utf-8"))[table]


def spread(mean_and_deviation: Sequence[float], form: str) -> str:
    """Mean and deviation as the paper prints them."""
    mean, deviation = mean_and_deviation
    return f"{mean:{form}} ± {deviation:{form}}"


def spread_of(values: Floats, form: str) -> str:
    """Mean and standard deviation of the values; a dash when there are none."""
    return spread([float(values.mean()), float(values.std())], form) if len(values) else "-"
