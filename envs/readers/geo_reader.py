"""A Gmsh script being read into a model."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from envs.readers.geo_model import Model
from envs.readers.geo_script import Script


@dataclass
class Reader:
    """A script being read into a model.

    Attributes:
        script: it.
        model: what it defined so far.
        folder: of the script: files that it includes lie below.
        factory: the kernel that it asks for.
        included: bytes of included files so far.
        blocks: loops, tests, macros and included files in each other.
    """

    script: Script
    model: Model
    folder: Path
    factory: str = "Built-in"
    included: int = 0
    blocks: int = 0
