"""An endless supply of domains that a function of a user's draws."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from envs.plug_ins.lookup import function
from envs.plug_ins.named_object import PlugIn
from envs.polygons.validation import domains_of
from envs.readers.python_objects import polygons_of
from envs.types import Domain, DomainError

KEY = "curriculum.stages"
#: Of the generators that draw the domains that are evaluated on, with their numbers; those of training have others.
HELD_OUT = 2**63


@dataclass(frozen=True)
class UserDomains:
    """A supply that is named ``package.module:Name``: a function of a generator of random numbers to a polygon.

    Attributes:
        spec: its name.
        vertices: most ring vertices of a domain drawn, seams included.
        elements: most elements of an episode.
    """

    spec: str
    vertices: int = 512
    elements: int = 16_384

    @property
    def name(self) -> str:
        """What tasks and curricula call it: its name without the module's."""
        return self.spec.rpartition(":")[2].rpartition(".")[2]

    def function(self) -> PlugIn:
        """The function.

        Raises:
            PluginError: there is none of this name.
        """
        return function(self.spec, KEY, "a function of a generator of random numbers")

    def draw(self, random: np.random.Generator) -> Domain:
        """The next domain.

        Raises:
            PluginError: the function raised, or drew no polygon that can be meshed.
        """
        return self._drawn(random, self.name)

    def held_out(self, count: int) -> list[Domain]:
        """The same ``count`` domains every time, to evaluate on."""
        return [self._drawn(np.random.default_rng([HELD_OUT, i]), f"{self.name}-held-out-{i}") for i in range(count)]

    def _drawn(self, random: np.random.Generator, name: str) -> Domain:
        draw = self.function()
        polygon = draw(random)
        try:
            found = [replace(polygon, name=name)] if isinstance(polygon, Domain) else domains_of(
                polygons_of(polygon, name), name, name, fix_parity=True, edge_length=None
            )  # fmt: skip
        except DomainError as error:
            raise draw.wrong(f"drew what cannot be meshed ({error})", "draw another polygon") from error
        if len(found) != 1:
            raise draw.wrong(f"drew {len(found)} polygons", "draw one")
        domain = found[0]
        if not 6 <= len(domain.ring) <= self.vertices:
            raise draw.wrong(f"drew {len(domain.ring)} vertices", f"draw 6 to {self.vertices}")
        return domain
