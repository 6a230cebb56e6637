"""How good a policy is: the paper's evaluation episodes, deterministic and stochastic."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from envs.domains.load import Source
from envs.mdp.episodes import Episodes
from envs.mesh import Mesh
from envs.plug_ins.lookup import function
from envs.plug_ins.named_object import PlugIn
from envs.types import Domain
from envs.wrappers.outermost import base
from envs.wrappers.wrapped_env import wrapped
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

    @property
    def score(self) -> float:
        """In [0, 1]: the mean element quality of a completed mesh, 0 where it was not completed.

        Unlike the return it does not depend on how the reward is weighted.
        """
        return self.mean_eta if self.completed else 0.0


class Figure(NamedTuple):
    """What an evaluation tells, a mean over its episodes.

    Attributes:
        unit, meaning: as the documents have them.
        of: from an episode to its part of the mean.
    """

    unit: str
    meaning: str
    of: Callable[[Evaluated], float]


#: The figures of an evaluation, in the order in which they are written down.
FIGURES: dict[str, Figure] = {
    "return": Figure("reward", "undiscounted sum of the rewards of an episode", lambda one: one.episode_return),
    "completion_rate": Figure("share", "meshes that were completed", lambda one: one.completed),
    "elements": Figure("count", "elements cut", lambda one: len(one.mesh.quads)),
    "element_quality": Figure("0 to 1", "mean eta of the elements cut", lambda one: one.mean_eta),
    "score": Figure("0 to 1", "mean eta of a completed mesh, 0 of one that was not completed", lambda one: one.score),
    "invalid": Figure("count", "actions rejected", lambda one: one.invalid),
}
#: Ways of acting that are evaluated: the squashed mean, drawn from only after a rejection; and every action drawn.
MODES = DETERMINISTIC, STOCHASTIC = ("deterministic", "stochastic")


def metric(mode: str, figure: str, domain: str | None = None) -> str:
    """The name under which a figure is recorded: of a domain, or of the mean over all stages."""
    return f"eval_{mode}/{figure}" if domain is None else f"eval_{mode}/{domain}/{figure}"


#: Every metric that an evaluation has whatever its domains.
METRICS = tuple(metric(mode, figure) for mode in MODES for figure in FIGURES)
RETURN, STOCHASTIC_RETURN = (metric(mode, "return") for mode in MODES)
COMPLETION, ELEMENTS, QUALITY, SCORE = (
    metric(DETERMINISTIC, figure) for figure in ("completion_rate", "elements", "element_quality", "score")
)


def mode_and_figure(name: str) -> tuple[str, str]:
    """The two parts of one of `METRICS`."""
    mode, _, figure = name.removeprefix("eval_").partition("/")
    return mode, figure


#: The setting that names figures of a user's own.
KEY = "evaluation.metrics"

#: Domains that an endless supply is evaluated on.
HELD_OUT_DOMAINS = 40


def run_episodes(policy: Policy, domain: Domain, episodes: int, *, stochastic: bool, seed: int) -> list[Evaluated]:
    """Mesh a domain several times, side by side.

    Args:
        policy: with the MDP's parameters, and the plug-ins, that it was trained on.
        domain: what to mesh.
        episodes: how many times, >= 1.
        stochastic: draw every action; otherwise take the squashed mean, and draw only where the last action was
            invalid (the front is unchanged, so the mean would be rejected again).
        seed: of the draws.

    Returns:
        One result an episode, in order.

    Raises:
        PluginError: a plug-in failed.
    """
    if policy.plug_ins.wrappers:
        return _run_wrapped(policy, domain, episodes, stochastic, seed)
    plugged = {"reward": policy.plug_ins.reward, "observe": policy.plug_ins.observe}
    batch = Episodes([domain], policy.parameters, episodes, **plugged)
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


def _run_wrapped(policy: Policy, domain: Domain, episodes: int, stochastic: bool, seed: int) -> list[Evaluated]:
    """`run_episodes` where plug-ins wrap every environment."""
    plug_ins = policy.plug_ins
    own = {"reward": plug_ins.reward, "observe": plug_ins.observe, "parameters": policy.parameters}
    environments = [wrapped(plug_ins.wrappers, domain=domain, **own) for _ in range(episodes)]
    random = np.random.default_rng(seed)
    seen = np.stack([env.reset(seed=seed + i)[0] for i, env in enumerate(environments)])
    over, invalid = np.zeros(episodes, dtype=np.bool_), np.zeros(episodes, dtype=np.bool_)
    returns = np.zeros(episodes)
    while not over.all():
        actions = policy.act(seen, stochastic | invalid, random)
        for i in np.flatnonzero(~over).tolist():
            seen[i], reward, terminated, truncated, info = environments[i].step(actions[i])
            returns[i] += reward
            invalid[i], over[i] = bool(info.get("rejection")), terminated or truncated
    batches = [base(env).episodes for env in environments]
    for env in environments:
        env.close()
    return [
        Evaluated(batch.mesh(0), float(returns[i]), batch.steps(0), batch.mean_eta(0))
        for i, batch in enumerate(batches)
    ]


def evaluation_episodes(
    policy: Policy, entry: Source, episodes: int, *, stochastic: bool, seed: int
) -> list[Evaluated]:
    """``episodes`` episodes on a domain; of an endless supply, one on each of the same unseen domains."""
    if isinstance(entry, Domain):
        return run_episodes(policy, entry, episodes, stochastic=stochastic, seed=seed)
    return [
        run_episodes(policy, domain, 1, stochastic=stochastic, seed=seed)[0]
        for domain in entry.held_out(HELD_OUT_DOMAINS)
    ]


def user_metric(spec: str) -> PlugIn:
    """The metric of a name: a function of an `Evaluated` to a number, or to numbers by name.

    Raises:
        PluginError: it is none.
    """
    return function(spec, KEY, "a function of an episode")


def summary(results: Sequence[Evaluated], metrics: Sequence[PlugIn] = ()) -> dict[str, float]:
    """Each of `FIGURES`, and each of a user's: its mean over episodes.

    Raises:
        PluginError: a user's raised, or is no number, or has another's name.
    """
    means = {name: float(np.mean([figure.of(one) for one in results])) for name, figure in FIGURES.items()}
    for metric_ in metrics:
        found = [_figures(metric_, one) for one in results]
        for name in found[0]:
            if name in means or not re.fullmatch(r"[\w.-]+", name):
                fix = "give it a name of its own, of letters, digits and . _ -"
                raise metric_.wrong(f"calls a figure {name!r:.60}", fix)
            if any(one.keys() != found[0].keys() for one in found):
                raise metric_.wrong("returned other names for another episode", "return the same names")
            means[name] = float(np.mean([one[name] for one in found]))
    return means


def _figures(metric_: PlugIn, one: Evaluated) -> dict[str, float]:
    """What a user's metric tells of an episode."""
    returned = metric_(one)
    figures: Mapping[Any, Any] = returned if isinstance(returned, Mapping) else {metric_.name: returned}
    return {str(name): metric_.as_number(value) for name, value in figures.items()}


def evaluate(
    policy: Policy, entry: Source, episodes: int, seed: int, metrics: Sequence[PlugIn] = ()
) -> dict[str, dict[str, float]]:
    """Mode -> `summary` of `evaluation_episodes` of that mode."""
    return {
        mode: summary(evaluation_episodes(policy, entry, episodes, stochastic=mode == STOCHASTIC, seed=seed), metrics)
        for mode in MODES
    }
