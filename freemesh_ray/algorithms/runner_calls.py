"""Calls to remote env runners that are asked first and answered later, so that something else is done meanwhile."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import ray
from ray.exceptions import RayError

from freemesh_ray.algorithms.awake import asleep
from freemesh_ray.algorithms.env_runner import Failure


class RunnerCalls:
    """One call at a time to each of a group's remote env runners.

    Args:
        manager: RLlib's of the group's actors.
        patience: seconds without an answer after which a runner is replaced.
    """

    def __init__(self, manager: Any, patience: float) -> None:
        self._manager, self._patience = manager, patience
        #: Each runner's answer to come.
        self._asked: dict[int, Any] = {}

    def __len__(self) -> int:
        """Answers to come."""
        return len(self._asked)

    def ask(self, method: str, request: Mapping[str, Any]) -> None:
        """Call ``method`` of every runner that is well and owes no answer."""
        actors = self._manager.actors()
        for runner in self._manager.healthy_actor_ids():
            if runner not in self._asked:
                self._asked[runner] = getattr(actors[runner], method).remote(**request)

    def answers(self) -> dict[int, Any]:
        """Each runner's answer, or the Failure of one that died or did not answer in time and is started anew.

        One that could not answer because all were asleep goes on: its answer comes with the next ones.
        """
        slept = asleep()
        ready, late = ray.wait(
            list(self._asked.values()), num_returns=len(self._asked), timeout=self._patience, fetch_local=True
        )
        runners = {answer: runner for runner, answer in self._asked.items()}
        found = {runner: self._answer(runner, answer) for runner, answer in self._asked.items() if answer in ready}
        if asleep() == slept:
            for runner in (runners[answer] for answer in late):
                ray.kill(self._manager.actors()[runner], no_restart=False)
                self._manager.set_actor_state(runner, healthy=False)
                found[runner] = Failure(f"no answer within {self._patience:g} s")
        self._asked = {runner: answer for runner, answer in self._asked.items() if runner not in found}
        return found

    def _answer(self, runner: int, answer: Any) -> Any:
        try:
            return ray.get(answer)
        except RayError:
            self._manager.set_actor_state(runner, healthy=False)
            return Failure("its process died")
