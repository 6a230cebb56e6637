"""How many env runners a training has."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from typing import Any

#: Gradient updates for each env step above which one env runner collects all that a learner takes (docs/scaling.md).
ENOUGH = 0.01
#: Seconds of one step of a runner's environments, and more for each of them; and those of a round's answer and weights.
STEP, ENVIRONMENT, MESSAGES = 9e-5, 2.8e-6, 2.5e-3


def runner_count(config: Mapping[str, Any]) -> int:
    """``runners.count``; where that is ``auto``, by this machine's cores, the updates and the steps of a round.

    One core is the learner's. With a replay buffer there are as many runners as the learner can take experience from;
    none where a round's few steps are sooner taken than sent, as with the defaults. ppo's learner waits for whole
    episodes, so that its runners have all cores. On one core the training's process samples itself.

    Args:
        config: a complete tree.
    """
    learner, runners = config["learner"], config["runners"]
    count: int | str = runners["count"]
    if isinstance(count, int):
        return count
    cores = len(os.sched_getaffinity(0))
    if cores == 1:
        return 0
    if config["algorithm"] == "ppo":
        return cores
    if runners["fragment"] * (STEP + ENVIRONMENT * runners["envs_per_runner"]) < MESSAGES:
        return 0
    return max(0, min(math.ceil(ENOUGH / learner["updates_per_step"]), cores - max(1, learner["count"])))
