"""The one way to leave an iteration early: between two rounds, where all that an algorithm is can be saved."""

from __future__ import annotations


class Cut(KeyboardInterrupt):
    """An iteration, or an evaluation, that was left since it was `hurried`; the algorithm is as after a round."""
