"""Patches around irregular vertices are emptied and filled anew with fewer of them."""

from freemesh_ray.finish.refill.every_patch import EFFORTS, USUAL, Effort, refill

__all__ = ["EFFORTS", "USUAL", "Effort", "refill"]
