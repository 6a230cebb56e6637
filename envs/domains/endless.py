"""Endless supplies of domains: one seed, one domain, and seeds that no training draws."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from envs.types import Domain

#: Seeds from here on are kept from training; the first are called ``NAME-held-out-0``, ``NAME-held-out-1``, ...
HELD_OUT = 2**62
HELD_OUT_PREFIX = "held-out-"


@dataclass(frozen=True)
class EndlessDomains(ABC):
    """Every draw is a domain that was never seen before.

    Attributes:
        name: what tasks and curricula call it; the domains drawn are called ``NAME-SEED``.
        vertices: most ring vertices of a domain drawn, seams included.
        elements: most elements a domain drawn may be expected to need.
    """

    name: str
    vertices: int
    elements: int

    @abstractmethod
    def domain(self, seed: int) -> Domain:
        """The domain of a seed, 0 to 2**63 - 1."""

    def draw(self, random: np.random.Generator) -> Domain:
        """A domain of the seeds below ``HELD_OUT``."""
        while True:
            domain = self.domain(int(random.integers(HELD_OUT)))
            if len(domain.ring) <= self.vertices:
                return domain

    def held_out(self, count: int) -> list[Domain]:
        """The first ``count`` domains that are never drawn, to evaluate on."""
        return [self.domain(HELD_OUT + i) for i in range(count)]
