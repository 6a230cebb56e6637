"""How good a policy is: the paper's evaluation episodes, deterministic and stochastic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from envs.domains.load import RandomDomains
from envs.mdp.episodes import Episodes
from envs.mesh import Mesh
from envs.types import Domain
from freemesh_ray.policies.policy import Policy


@dataclass(frozen=True)
class Evaluated:
    """One evaluation episode.

    Attributes:
        mesh: what was cut.
        episode_return: undiscounted sum of rewards.
        steps: actions, invalid ones included.
        mean_eta: mean element quality, [0, 1].
    """

    mesh: Mesh
    episode_return: float
    steps: int
    mean_eta: float

    @property
    def completed(self) -> bool:
        """Whether the mesh fills its domain."""
        return self.mesh.complete

    @property
    def invalid(self) -> int:
        """Actions that were rejected: all but one an element, and the last action of a mesh cuts two."""
        return self.steps - len(self.mesh.quads) + int(self.completed)


#: Ways of acting that are evaluated: the squashed mean, and draws.
KINDS = ("deterministic", "stochastic")
#: What `summary` tells.
FIGURES = ("return", "completion_rate", "elements", "element_quality", "score", "invalid")
#: Domains that an endless supply is evaluated on.
HELD_OUT_DOMAINS = 40


def run_episodes(policy: Policy, domain: Domain, episodes: int, *, stochastic: bool, seed: int) -> list[Evaluated]:
    """Mesh a domain several times, side by side.

    Args:
        policy: with the MDP's parameters that it was trained on.
        domain: what to mesh.
        episodes: how many times, >= 1.
        stochastic: draw every action; otherwise take the squashed mean, and draw only where the last action was
            invalid (the front is unchanged, so the mean would be rejected again).
        seed: of the draws.

    Returns:
        One result an episode, in order.
    """
    batch = Episodes([domain], policy.parameters, episodes)
    random = np.random.default_rng(seed)
    for i in range(episodes):
        batch.start(i, 0)
    over = np.zeros(episodes, dtype=np.bool_)
    invalid = np.zeros(episodes, dtype=np.int64)  # in a row
    while not over.all():
        actions = policy.act(batch.out.observation, stochastic | (invalid > 0), random)
        out = batch.step(actions, skip=over)
        invalid = np.where(out.rejection > 0, invalid + 1, 0)
        over |= out.terminated | out.truncated
    return [
        Evaluated(batch.mesh(i), batch.episode_return(i), batch.steps(i), batch.mean_eta(i)) for i in range(episodes)
    ]


def evaluation_episodes(
    policy: Policy, entry: Domain | RandomDomains, episodes: int, *, stochastic: bool, seed: int
) -> list[Evaluated]:
    """``episodes`` episodes on a domain; of an endless supply, one on each of the same unseen domains."""
    if isinstance(entry, Domain):
        return run_episodes(policy, entry, episodes, stochastic=stochastic, seed=seed)
    return [
        run_episodes(policy, domain, 1, stochastic=stochastic, seed=seed)[0]
        for domain in entry.held_out(HELD_OUT_DOMAINS)
    ]


def summary(results: list[Evaluated]) -> dict[str, float]:
    """Means over episodes: return, completion rate, elements, element quality, score, invalid actions.

    The score is the element quality of a completed mesh, and 0 where the mesh was not completed: a figure in [0, 1]
    that does not depend on how the reward is weighted.
    """
    return {
        "return": float(np.mean([result.episode_return for result in results])),
        "completion_rate": float(np.mean([result.completed for result in results])),
        "elements": float(np.mean([len(result.mesh.quads) for result in results])),
        "element_quality": float(np.mean([result.mean_eta for result in results])),
        "score": float(np.mean([result.mean_eta * result.completed for result in results])),
        "invalid": float(np.mean([result.invalid for result in results])),
    }
