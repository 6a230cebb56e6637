"""A training that is to end amid an iteration, an evaluation or its last meshes: what was done is in a checkpoint."""

from __future__ import annotations

from typing import Any

import pytest
from test_training import Fake, run
from told import told

from freemesh_ray.algorithms.cut import Cut


class Hurried(Fake):
    """Leaves the iteration, or the evaluation, in which it has taken so many steps."""

    def __init__(self, at: int, where: str) -> None:
        super().__init__()
        self.at, self.where, self.asked = at, where, False

    def train(self) -> dict[str, Any]:
        if self.where == "an iteration" and self.env_steps + 100 > self.at:
            self.env_steps, self.asked = self.at, True
            raise Cut
        return super().train()

    def evaluate(self) -> dict[str, Any]:
        if self.where == "an evaluation" and self.env_steps >= self.at:
            self.asked = True
            raise Cut
        return super().evaluate()


@pytest.mark.slow
@pytest.mark.parametrize(("at", "where"), [(550, "an iteration"), (600, "an evaluation"), (1000, "an evaluation")])
def test_what_was_done_is_saved(at: int, where: str, settings: dict[str, Any]) -> None:
    fake, notes = Hurried(at, where), list[str]()
    with pytest.raises(KeyboardInterrupt):
        run(settings, fake, interrupted=lambda: fake.asked, callbacks=told(note=notes.append))
    assert f"interrupted at {at:,} steps; saved " in notes[-1]
    again = Fake()
    trained = run(settings, again, resume=True)
    assert trained.progress.env_steps >= 1000
    assert trained.progress.evaluated_at == trained.progress.env_steps
    assert len(trained.stages) == 1


@pytest.mark.slow
def test_the_last_meshes_are_not_waited_for(settings: dict[str, Any]) -> None:
    fake = Fake()
    asked = iter([False] * 11)
    with pytest.raises(KeyboardInterrupt):
        run(settings, fake, interrupted=lambda: next(asked, True))
    assert fake.env_steps == 1000
    assert len(run(settings, Fake(), resume=True).stages) == 1
