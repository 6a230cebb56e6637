"""The curriculum: which domain the next episodes are on. Pure: (stage, results) -> stage; no Ray, no clock.

Stage k trains on ``stages[k]``, with a share of ``rehearsal`` spread over the stages before it so that they are not
forgotten. It ends when the completion rate of its own domain over the last ``window`` episodes reaches ``promote_at``,
or after ``max_stage_steps`` env steps. The last stage never ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any


@dataclass(frozen=True)
class Curriculum:
    """Where training stands; the defaults are those of a configuration.

    Attributes:
        stages: domain names, in order.
        promote_at: completion rate that ends a stage, (0, 1].
        window: episodes of the stage's own domain that the rate is taken over, >= 1.
        max_stage_steps: env steps after which a stage ends anyway.
        rehearsal: share of episodes on earlier stages, [0, 1).
        stage: index of the current stage.
        stage_steps: env steps taken in it.
        recent: whether each of the last ``window`` episodes on its domain was completed, oldest first.
    """

    stages: tuple[str, ...]
    promote_at: float = 0.7
    window: int = 50
    max_stage_steps: int = 100_000
    rehearsal: float = 0.3
    stage: int = 0
    stage_steps: int = 0
    recent: tuple[bool, ...] = ()

    def __post_init__(self) -> None:
        if not self.stages:
            raise ValueError("a curriculum needs at least one stage")
        if len(set(self.stages)) != len(self.stages):
            raise ValueError(f"a curriculum's stages must differ: {', '.join(self.stages)}")
        if not (
            0 < self.promote_at <= 1 and 0 <= self.rehearsal < 1 and self.window >= 1 and self.max_stage_steps >= 1
        ):
            raise ValueError("a curriculum needs promote_at in (0, 1], rehearsal in [0, 1), window and steps above 0")

    @property
    def name(self) -> str:
        """The current stage's domain."""
        return self.stages[self.stage]

    @property
    def rate(self) -> float:
        """Completion rate over the recent episodes on the current domain; 0 before there is one."""
        return sum(self.recent) / len(self.recent) if self.recent else 0.0

    def task(self) -> dict[str, float]:
        """Weight of each domain for the episodes to come, adding up to 1."""
        earlier = self.stages[: self.stage]
        if not earlier:
            return {self.name: 1.0}
        return dict.fromkeys(earlier, self.rehearsal / len(earlier)) | {self.name: 1.0 - self.rehearsal}

    def after(self, steps: int, episodes: Sequence[tuple[str, bool]]) -> Curriculum:
        """The curriculum ``steps`` env steps and these (domain, completed) episodes later."""
        own = tuple(completed for domain, completed in episodes if domain == self.name)
        recent = (self.recent + own)[-self.window :]
        here = replace(self, stage_steps=self.stage_steps + steps, recent=recent)
        learnt = len(recent) == self.window and here.rate >= self.promote_at
        if self.stage + 1 < len(self.stages) and (learnt or here.stage_steps >= self.max_stage_steps):
            return replace(self, stage=self.stage + 1, stage_steps=0, recent=())
        return here

    def state(self) -> dict[str, Any]:
        """What changes while training."""
        return {"stages": self.stages, "stage": self.stage, "stage_steps": self.stage_steps, "recent": self.recent}

    def restored(self, state: dict[str, Any]) -> Curriculum:
        """This curriculum, at the point of ``state``.

        Raises:
            ValueError: the state is of other stages.
        """
        if tuple(state["stages"]) != self.stages:
            raise ValueError(
                f"the checkpoint's curriculum is {' -> '.join(state['stages'])}, the configuration's "
                f"{' -> '.join(self.stages)}: resume with the same stages, or start a new run"
            )
        return replace(
            self,
            stage=int(state["stage"]),
            stage_steps=int(state["stage_steps"]),
            recent=tuple(state["recent"])[-self.window :],
        )
