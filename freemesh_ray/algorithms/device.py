"""Where learners compute: ``learner.device`` as a number of GPUs for each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch

from freemesh_ray.config import ConfigError


def check(learner: Mapping[str, Any]) -> None:
    """Before Ray is up: that a learner in this process is asked for no GPU that there is not.

    Args:
        learner: a configuration's section.

    Raises:
        ConfigError: it is.
    """
    if learner["count"] == 0:
        gpus_per_learner(learner["device"], 0, gpus_here(0))


def gpus_here(learners: int) -> int:
    """GPUs that learners can have: with ``learners`` 0 this process's, else the cluster's."""
    return torch.cuda.device_count() if learners == 0 else cluster_gpus()


def cluster_gpus() -> int:
    """GPUs that Ray has to give, in use or not; none if torch is a build that cannot use them."""
    import ray  # not before `local_ray` has set what Ray reads when it is imported

    return int(ray.cluster_resources().get("GPU", 0)) if torch.backends.cuda.is_built() else 0


def gpus_per_learner(device: str, learners: int, gpus: int) -> int:
    """1 on CUDA, 0 on the CPU.

    Args:
        device: ``auto`` (CUDA if there is a GPU for every learner), ``cpu`` or ``cuda``.
        learners: remote ones; 0: one in this process.
        gpus: how many there are.

    Raises:
        ConfigError: ``cuda``, and there are too few GPUs.
    """
    enough = gpus >= max(1, learners)
    if device == "cuda" and not enough:
        wanted = max(1, learners)
        raise ConfigError(f"learner.device: cuda needs {wanted} GPU(s), there are {gpus}: use auto or cpu")
    return int(enough and device != "cpu")
