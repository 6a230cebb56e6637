"""A mesh in, a better one out; the boundary stays as it is."""

from freemesh_ray.finish.finish import Finished, finish
from freemesh_ray.finish.refill import EFFORTS, USUAL

__all__ = ["EFFORTS", "USUAL", "Finished", "finish"]
