"""What a training records of its iterations: every metric's name, unit, meaning and value, in one place.

Those of its evaluations are the figures of `freemesh_ray.policies.evaluation`, those of its learner stand with its
algorithm in `freemesh_ray.config.algorithms`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np


class Iteration(NamedTuple):
    """One iteration of the training loop.

    Attributes:
        stage: of the curriculum, from 0.
        updates, seconds: gradient updates and wall clock of the training so far.
        new_updates, took: those of the iteration.
    """

    stage: int
    updates: int
    seconds: float
    new_updates: int
    took: float


class Metric(NamedTuple):
    """What is recorded.

    Attributes:
        unit, meaning: as the documents have them.
        of: from what it is a figure of to its value.
    """

    unit: str
    meaning: str
    of: Callable[[Any], float]


#: Of an `Iteration`.
ITERATION: dict[str, Metric] = {
    "train/stage": Metric("index", "stage of the curriculum, from 0", lambda it: it.stage),
    "train/updates": Metric("count", "gradient updates so far", lambda it: it.updates),
    "train/seconds": Metric("s", "so far, over all starts, without sleep", lambda it: it.seconds),
    "train/updates_per_second": Metric("1/s", "gradient updates of the iteration", lambda it: it.new_updates / it.took),
}
#: Of a result tree's env runners, where they tell it: of learning from a replay buffer.
RUNNERS: dict[str, Metric] = {
    "train/weights_age": Metric(
        "updates", "since the weights that the last round was collected with", lambda runners: runners["weights_age"]
    ),
}
#: Of the episodes that ended in the iteration: means, missing where none ended.
EPISODES: dict[str, Metric] = {
    "train/return": Metric("reward", "undiscounted sum of rewards", lambda one: one.episode_return),
    "train/completion_rate": Metric("share", "meshes that were completed", lambda one: one.completed),
    "train/episode_length": Metric("env steps", "actions, rejected ones included", lambda one: one.length),
    "train/elements": Metric("count", "elements cut", lambda one: one.elements),
    "train/element_quality": Metric("0 to 1", "mean eta of the elements cut", lambda one: one.mean_eta),
}


def of_iteration(
    iteration: Iteration, ended: Iterable[Any], results: Mapping[str, Any], learner_figures: Iterable[str]
) -> dict[str, float]:
    """All metrics of an iteration.

    Args:
        iteration: the training's own figures.
        ended: the episodes that ended in it.
        results: a result tree as RLlib's.
        learner_figures: names of those of the learner that are recorded, where it reports them.
    """
    values = {name: float(metric.of(iteration)) for name, metric in ITERATION.items()}
    if episodes := list(ended):
        values |= {name: float(np.mean([metric.of(one) for one in episodes])) for name, metric in EPISODES.items()}
    runners = results.get("env_runners", {})
    values |= {name: float(metric.of(runners)) for name, metric in RUNNERS.items() if "weights_age" in runners}
    learner = results.get("learners", {}).get("default_policy", {})
    return values | {f"learner/{name}": float(learner[name]) for name in learner_figures if name in learner}
