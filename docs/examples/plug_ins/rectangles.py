"""A domain source: a new rectangle every episode, its sides cut into equal segments.

curriculum:
  stages: [rectangles:rectangle]
"""

import numpy as np


def rectangle(random: np.random.Generator) -> np.ndarray:
    m, n = random.integers(2, 7, size=2)
    corners = np.array([[0, 0], [m, 0], [m, n], [0, n]], dtype=float)
    sides = zip(corners, np.roll(corners, -1, axis=0), (m, n, m, n), strict=True)
    return np.concatenate([np.linspace(start, end, count, endpoint=False) for start, end, count in sides])
