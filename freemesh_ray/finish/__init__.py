"""A mesh in, a better one out; the boundary stays as it is."""

from freemesh_ray.finish.optimiser import NO_SIZES
from freemesh_ray.finish.refill import EFFORTS, USUAL
from freemesh_ray.finish.whole_finish import Finished, finish

__all__ = ["EFFORTS", "NO_SIZES", "USUAL", "Finished", "finish"]
