"""A metric of an evaluation: the longest edge of an element over its shortest, in the mean and at worst.

evaluation:
  metrics: [aspect:aspect]
"""

import numpy as np

from freemesh_ray.policies.evaluation import Evaluated


def aspect(episode: Evaluated) -> dict[str, float]:
    corners = episode.mesh.vertices[episode.mesh.quads]  # (elements, 4, 2)
    edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    ratios = np.append(edges.max(axis=1) / edges.min(axis=1), 1.0)  # 1 where no element was cut
    return {"aspect": float(ratios.mean()), "aspect_worst": float(ratios.max())}
