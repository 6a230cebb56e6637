"""What of an environment is a user's own."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PlugIns:
    """What of an environment is a user's own, by name.

    Attributes:
        reward: a function of a step.
        observe: a class of observations.
        wrappers: classes of Gymnasium wrappers, the innermost first.
    """

    reward: str | None = None
    observe: str | None = None
    wrappers: tuple[str, ...] = ()

    @property
    def alter(self) -> bool:
        """Whether a policy sees or does something else than in the environment as it is."""
        return bool(self.observe or self.wrappers)

    def __str__(self) -> str:
        named = {"env.reward": self.reward, "env.observe": self.observe, "env.wrappers": ", ".join(self.wrappers)}
        return ", ".join(f"{key} = {spec}" for key, spec in named.items() if spec)


#: An environment as it is.
NONE = PlugIns()
