"""A curriculum of any stages, with the defaults of the configuration."""

from __future__ import annotations

from typing import Any

from freemesh_ray import config
from freemesh_ray.algorithms.curriculum import Curriculum


def curriculum(*stages: str, **settings: Any) -> Curriculum:
    return Curriculum(**{**config.load()["curriculum"], "stages": stages, **settings})
