"""The folder of a run: where its parts lie.

runs/NAME/config.yaml            the resolved configuration
          evaluations.jsonl      one line an evaluation
          checkpoints/step_...   to go on from
          policy.npz             the best policy
          learning_curve.png
          meshes/                every stage meshed with it, raw and finished
          tracking/              the tracking journal
          failures.log           what went wrong and was recovered from
          .lock                  held by the process that trains here
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from envs.errors import FAILED, UserError
from freemesh_ray.config.paths import elsewhere
from freemesh_ray.storage.atomic import replacing
from freemesh_ray.storage.json_file import parsed, read_text
from freemesh_ray.storage.lock import FILE, held
from freemesh_ray.training import checkpoint


class RunError(UserError, RuntimeError):
    """A run that cannot begin or go on; one line with its folder, what is wrong and the fix."""


class TrainingError(UserError, RuntimeError):
    """A run that fails again and again; one line with its folder, the last reason and where it can go on."""

    exit_code = FAILED


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
    def failures(self) -> Path:
        """Tracebacks of what the training recovered from, or did not."""
        return self.path / "failures.log"

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
    def lock(self) -> Path:
        """Held by the process that trains here; the file stays."""
        return self.path / FILE

    @property
    def meshes(self) -> Path:
        """Folder of the stages' meshes."""
        return self.path / "meshes"

    @contextmanager
    def claimed(self, resume: bool) -> Iterator[None]:
        """Make the folder for a run and hold its lock.

        Raises:
            RunError: it has checkpoints and ``resume`` is false, or it cannot be made.
            InUseError: another process trains in it.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RunError(f"{self.path}: cannot be made ({error.strerror}): {elsewhere('paths.runs')}") from error
        if not os.access(self.path, os.W_OK):
            raise RunError(f"{self.path}: cannot be written to: {elsewhere('paths.runs')}")
        with held(self.path, "wait for its end, or --set name=OTHER to begin another"):
            started = bool(checkpoint.found(self.checkpoints))
            if started and not resume:
                raise RunError(
                    f"{self.path} already holds a run: add --resume to go on, or --set name=OTHER to begin another"
                )
            if not started:
                self.forget_after(-1)
            yield

    def read_evaluations(self) -> list[dict[str, Any]]:
        """One entry an evaluation, in the order of their steps; a damaged line, as a kill leaves it, is left out.

        Raises:
            RunError: the file is none of a training's.
        """
        lines = sorted(self._lines(), key=evaluated_at)
        return [json.loads(line) for line in lines if math.isfinite(evaluated_at(line))]

    def forget_after(self, env_steps: int) -> None:
        """Drop the evaluations later than ``env_steps``: a run that goes on from there will make them again.

        Raises:
            RunError: the file is none of a training's.
        """
        if self.evaluations.is_file():
            kept = [line for line in self._lines() if evaluated_at(line) <= env_steps]
            with replacing(self.evaluations) as draft:
                draft.write_text("".join(f"{line}\n" for line in kept), encoding="utf-8")

    def _lines(self) -> list[str]:
        """The lines of the evaluations; none where there is no file."""
        try:
            return read_text(self.evaluations).splitlines()
        except OSError:
            return []
        except ValueError as error:
            raise RunError(f"{self.evaluations}: is no list of evaluations ({error}): move it away") from error


def evaluated_at(line: str) -> float:
    """The env steps of one line of evaluations; infinite for a damaged one, as a kill leaves it."""
    try:
        steps = float(parsed(line)["env_steps"])
    except (ValueError, KeyError, TypeError, OverflowError):
        return math.inf
    return steps if steps >= 0 else math.inf
