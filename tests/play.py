"""What the tests of the meshing world play with: greedy episodes that get far into a mesh, and domains without ties."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from envs.domains.load import load
from envs.mdp.action import ACCEPTED
from envs.mdp.episodes import Episodes
from envs.mdp.front import Front, ring_slots
from envs.types import Domain, Floats, MeshingParameters


@dataclass(frozen=True)
class Turn:
    """Several actions, each tried in its own copy of one state.

    Attributes:
        before: the front that all of them met (a copy).
        actions: (tries, action size).
        episodes: after the actions; ``episodes.out`` is their outcome. Valid until the next turn.
        chosen: the accepted action that looks best, which the next turn goes on from; None when all were rejected.
    """

    before: Front
    actions: Floats
    episodes: Episodes
    chosen: int | None

    @property
    def after(self) -> Front:
        """The front that the chosen action left."""
        assert self.chosen is not None
        return self.episodes.front(self.chosen)


def turns(domain: Domain, seed: int, *, tries: int = 48, limit: int = 10_000, **options: Any) -> Iterator[Turn]:
    """Play until the mesh is complete, ten turns in a row find no valid action, or ``limit`` turns are over."""
    parameters = MeshingParameters(max_invalid=10**9, **options)
    episodes = Episodes([domain], parameters, tries)
    for i in range(tries):
        episodes.start(i, 0)
    rng, fruitless = np.random.default_rng(seed), 0
    for _ in range(limit):
        before = Front(*(array.copy() for array in episodes.front(0)))
        actions = rng.uniform(-1.0, 1.0, (tries, parameters.action_size))
        out = episodes.step(actions)
        accepted = out.rejection == ACCEPTED
        merit = out.terms @ [1.0, 1.0, 0.5, 0.0] + 10.0 * out.terminated
        chosen = int(np.argmax(np.where(accepted, merit, -np.inf))) if accepted.any() else None
        yield Turn(before, actions, episodes, chosen)
        fruitless = fruitless + 1 if chosen is None else 0
        if fruitless == 10 or (chosen is not None and (out.terminated[chosen] or out.truncated[chosen])):
            return
        state = episodes.get_state()
        for array in state["arrays"].values():
            array[:] = array[chosen or 0]
        episodes.set_state(state)


def coordinates(front: Front) -> Floats:
    """The ring that is left, from the reference vertex on; (ring, 2)."""
    return front.xy[ring_slots(front)]


def generic(domain: Domain | str, seed: int = 0, share: float = 0.02) -> Domain:
    """A domain shaken by a share of its shortest segment, so that no angles or lengths are equal."""
    domain = load(domain) if isinstance(domain, str) else domain
    ends = domain.points[domain.segments]
    shortest = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).min()
    noise = np.random.default_rng(seed).uniform(-1.0, 1.0, domain.points.shape)
    return replace(domain, points=domain.points + share * shortest * noise)


def record(domain: Domain, seed: int, steps: int, **options: Any) -> tuple[np.ndarray, ...]:
    """Observations, rewards and rejections of one episode of random actions, and its last front."""
    parameters = MeshingParameters(max_invalid=10**9, **options)
    episodes = Episodes([domain], parameters, 1)
    episodes.start(0, 0)
    out, rng = episodes.out, np.random.default_rng(seed)
    seen, rewards, rejections = [out.observation[0].copy()], [], []
    for _ in range(steps):
        episodes.step(rng.uniform(-1.0, 1.0, (1, parameters.action_size)))
        seen.append(out.observation[0].copy())
        rewards.append(out.reward[0])
        rejections.append(out.rejection[0])
        if out.terminated[0] or out.truncated[0]:
            break
    return np.array(seen), np.array(rewards), np.array(rejections), episodes.ring(0)
