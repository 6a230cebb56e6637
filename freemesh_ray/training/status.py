"""Where a training stands: its progress, which checkpoints keep, and the figures of a progress line."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Progress:
    """Where a training stands; saved in every checkpoint.

    Attributes:
        env_steps, updates: so far.
        seconds: of training, evaluation and checkpoints, over all its starts, without those that it was asleep.
        evaluated_at: env steps at the last evaluation.
        best: score of the best policy (completion rate, return), None before the first evaluation.
        best_steps: env steps of the best policy.
    """

    env_steps: int = 0
    updates: int = 0
    seconds: float = 0.0
    evaluated_at: int = 0
    best: list[float] | None = None
    best_steps: int = 0


@dataclass(frozen=True)
class Status:
    """One progress line's figures.

    Attributes:
        stage: name of the current domain.
        env_steps, budget_steps: taken, and to take.
        mean_return, completion_rate: over the last episodes; nan before there is one.
        updates_per_second: since the last line.
        seconds_left: estimate of the rest.
    """

    stage: str
    env_steps: int
    budget_steps: int
    mean_return: float
    completion_rate: float
    updates_per_second: float
    seconds_left: float
