"""The folder of a run: where its parts lie.

runs/NAME/config.yaml            the resolved configuration
          evaluations.jsonl      one line an evaluation
          checkpoints/step_...   to go on from
          policy.npz             the best policy
          learning_curve.png
          meshes/                every stage meshed with it
          tracking/              the tracking journal
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from freemesh_ray import checkpoint
from freemesh_ray.policy import PolicyError


class RunExistsError(RuntimeError):
    """A run of this name is there already and was not asked to go on."""


@dataclass(frozen=True)
class RunFolder:
    """Paths below one run's folder.

    Attributes:
        path: the folder; it need not exist.
    """

    path: Path

    @property
    def config(self) -> Path:
        """The resolved configuration."""
        return self.path / "config.yaml"

    @property
    def evaluations(self) -> Path:
        """JSON lines, one an evaluation."""
        return self.path / "evaluations.jsonl"

    @property
    def checkpoints(self) -> Path:
        """Folder of the checkpoints."""
        return self.path / "checkpoints"

    @property
    def policy(self) -> Path:
        """The best policy so far."""
        return self.path / "policy.npz"

    @property
    def curve(self) -> Path:
        """Picture of the evaluation returns."""
        return self.path / "learning_curve.png"

    @property
    def meshes(self) -> Path:
        """Folder of the stages' meshes."""
        return self.path / "meshes"

    def claim(self, resume: bool) -> None:
        """Make the folder for a run.

        Raises:
            RunExistsError: it has checkpoints and ``resume`` is false.
        """
        if not resume and checkpoint.found(self.checkpoints):
            raise RunExistsError(
                f"{self.path} already holds a run: add --resume to go on, or --set name=OTHER to begin another"
            )
        self.path.mkdir(parents=True, exist_ok=True)
        if not resume:
            # What an earlier run left that died before its first checkpoint.
            self.evaluations.unlink(missing_ok=True)


def newest_policy(runs: Path) -> Path:
    """The policy that was written last below ``runs``.

    Raises:
        PolicyError: there is none.
    """
    policies = sorted(runs.glob("*/policy.npz"), key=lambda path: path.stat().st_mtime)
    if not policies:
        raise PolicyError(f"{runs}: no trained policy below it; train one with `freemesh train`, or give --policy FILE")
    return policies[-1]
