"""A reward: the paper's, less half a point for an element whose edges are of very different lengths.

env:
  reward: even_edges:reward
"""

import numpy as np

from envs.mdp.user_defined import Step


def reward(step: Step) -> float:
    edges = np.linalg.norm(np.roll(step.elements, -1, axis=1) - step.elements, axis=2)  # (elements, 4)
    unevenness = 1.0 - edges.min(axis=1) / edges.max(axis=1)
    return step.reward - 0.5 * float(unevenness.sum())
