"""How many env runners a training has."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from typing import Any

#: Gradient updates for each env step above which one env runner collects all that a learner takes (docs/scaling.md).
ENOUGH = 0.01


def runner_count(config: Mapping[str, Any]) -> int:
    """``runners.count``; where that is ``auto``, by this machine's cores and the updates for each env step.

    One core is the learner's. With a replay buffer there are as many runners as the learner can take experience from,
    and one at least; ppo's learner waits for them, so that they have all cores. On one core the training's process
    samples itself.

    Args:
        config: a complete tree.
    """
    count: int | str = config["runners"]["count"]
    if isinstance(count, int):
        return count
    cores = len(os.sched_getaffinity(0))
    if cores == 1:
        return 0
    if config["algorithm"] == "ppo":
        return cores
    learner = config["learner"]
    wanted = math.ceil(ENOUGH / learner["updates_per_step"])
    return max(0, min(wanted, cores - max(1, learner["count"])))
