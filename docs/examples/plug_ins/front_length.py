"""An observation: the paper's, and how many vertices the front has left.

env:
  observe: front_length:WithFrontLength
"""

import numpy as np

from envs.mdp.observation import bounds
from envs.mdp.user_defined import View
from envs.types import MeshingParameters


class WithFrontLength:
    def __init__(self, parameters: MeshingParameters) -> None:
        low, high = bounds(parameters)
        self.low, self.high = np.append(low, 0.0), np.append(high, 1.0)

    def __call__(self, view: View) -> np.ndarray:
        return np.append(view.observation, min(1.0, len(view.front) / len(view.domain.ring)))
