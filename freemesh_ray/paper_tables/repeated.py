"""One domain meshed again and again by drawn actions, as the paper's studies of settings do."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from envs.quality import element_quality
from envs.types import Domain, Floats
from freemesh_ray.policies.evaluation import run_episodes
from freemesh_ray.policies.policy import Policy


@dataclass(frozen=True)
class Repeated:
    """The completed meshes of several episodes.

    Attributes:
        eta: (m,) element quality of all elements of all of them.
        elements: (c,) elements of each.
        seconds: (c,) wall time of each.
    """

    eta: Floats
    elements: Floats
    seconds: Floats


def repeat(policy: Policy, domain: Domain, episodes: int) -> Repeated:
    """Mesh a domain in several episodes, one after another, every action drawn; episode i with seed i."""
    run_episodes(policy, domain, 1, stochastic=True, seed=episodes)  # compiled code is warm from here on
    eta, elements, seconds = [np.empty(0)], [], []
    for seed in range(episodes):
        start = time.perf_counter()
        (result,) = run_episodes(policy, domain, 1, stochastic=True, seed=seed)
        elapsed = time.perf_counter() - start
        if result.completed:
            eta.append(element_quality(result.mesh.vertices, result.mesh.quads))
            elements.append(len(result.mesh.quads))
            seconds.append(elapsed)
    return Repeated(np.concatenate(eta), np.array(elements, dtype=np.float64), np.array(seconds))
