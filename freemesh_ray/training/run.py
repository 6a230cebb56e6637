"""What a training leaves."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from freemesh_ray.policies.policy import Policy
from freemesh_ray.training import checkpoint
from freemesh_ray.training.run_folder import RunFolder
from freemesh_ray.training.stage_meshes import StageMeshes
from freemesh_ray.training.status import Progress


@dataclass(frozen=True)
class Run:
    """A training that came to its end.

    Attributes:
        folder: where its files lie: ``folder.path``, ``folder.policy``, ``folder.curve``, ``folder.meshes`` and more.
        progress: at the end.
        stages: each meshed with the best policy.
    """

    folder: RunFolder
    progress: Progress
    stages: list[StageMeshes]

    @cached_property
    def policy(self) -> Policy:
        """The best policy, that of ``folder.policy``."""
        return Policy.load(self.folder.policy, altered=True)

    @cached_property
    def evaluations(self) -> list[dict[str, Any]]:
        """One entry an evaluation: ``env_steps``, ``seconds`` and its figures by metric."""
        return self.folder.read_evaluations()

    @property
    def checkpoint(self) -> Path | None:
        """The newest checkpoint; None in a trial of a study, whose checkpoints Ray Tune keeps."""
        return next(iter(checkpoint.found(self.folder.checkpoints)), None)
