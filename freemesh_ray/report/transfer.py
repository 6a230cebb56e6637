"""Every trained policy on every domain of the study, also those that it was not trained on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from envs.domains.load import Source, UserDomains, source
from envs.types import Domain, DomainError, Floats
from freemesh_ray.policies.evaluation import evaluate
from freemesh_ray.policies.policy import Policy, PolicyError
from freemesh_ray.report.results import TrialResult

#: Of the draws: the same for all policies.
SEED = 0


@dataclass(frozen=True)
class Transfer:
    """Figures of the trained policies.

    Attributes:
        domains: names of those that could be loaded.
        skipped: what the study calls a domain, or a trial -> why it is missing.
        policies: label, seed -> the best policy of the trial, in the order of the trials.
        figures: label, seed, domain, mode -> `evaluation.FIGURES`.
    """

    domains: list[str]
    skipped: dict[str, str]
    policies: Mapping[tuple[str, int], Policy]
    figures: Mapping[tuple[str, int, str, str], Mapping[str, float]]

    def of(self, label: str, figure: str, mode: str) -> Floats:
        """(n, m): a figure of the n policies of a variant on the m domains."""
        rows = [
            [self.figures[label, seed, domain, mode][figure] for domain in self.domains]
            for trained, seed in self.policies
            if trained == label
        ]
        return np.array(rows, dtype=np.float64).reshape(len(rows), len(self.domains))


def transfer(
    trials: Sequence[TrialResult],
    domains: Sequence[str],
    episodes: int,
    note: Callable[[str], None] = lambda line: None,
) -> Transfer:
    """Evaluate the best policy of each trial on each domain.

    Args:
        trials: those to look at.
        domains: names as of ``freemesh mesh``, or ``random``.
        episodes: on each domain, deterministic and again stochastic.
        note: called with a line for each policy.
    """
    found, skipped = load_domains(domains)
    policies: dict[tuple[str, int], Policy] = {}
    figures: dict[tuple[str, int, str, str], Mapping[str, float]] = {}
    for trial in trials:
        try:
            policy = policies[trial.label, trial.seed] = Policy.load(trial.policy)
        except PolicyError as error:
            skipped[f"{trial.label}, seed {trial.seed}"] = str(error)
            continue
        note(f"{trial.label}, seed {trial.seed}: {len(found)} domains")
        for name, entry in found.items():
            of_mode = evaluate(policy, entry, episodes, SEED)
            figures |= {(trial.label, trial.seed, name, mode): of_mode[mode] for mode in of_mode}
    return Transfer(list(found), skipped, policies, figures)


def load_domains(domains: Sequence[str]) -> tuple[dict[str, Source], dict[str, str]]:
    """Name -> domain; and what the study calls the others -> why they cannot be used."""
    found: dict[str, Source] = {}
    skipped: dict[str, str] = {}
    for spec in domains:
        try:
            entry = source(spec)
            if isinstance(entry, UserDomains):
                raise DomainError(f"{spec}: is a function of a user's own: a report runs none")
            if isinstance(entry, Domain) and len(entry.ring) < 6:
                raise DomainError(f"{spec}: {len(entry.ring)} vertices are one element")
        except DomainError as error:
            skipped[spec] = str(error)
        else:
            found[spec if entry.name in found else entry.name] = entry
    return found, skipped
