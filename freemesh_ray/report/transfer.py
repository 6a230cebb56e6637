"""Every trained policy on every domain of the study, also those that it was not trained on."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from envs.domains.load import Source, UserDomains, source
from envs.types import Domain, DomainError, Floats
from freemesh_ray.policies.evaluation import FIGURES, MODES, evaluate, metric
from freemesh_ray.policies.policy import Policy, PolicyError
from freemesh_ray.records.measured import Measured
from freemesh_ray.records.study_records import RecordsError, StudyRecords
from freemesh_ray.report.results import TrialResult

#: Of the draws: the same for all policies.
SEED = 0


@dataclass(frozen=True)
class Transfer:
    """Figures of the trained policies.

    Attributes:
        domains: names of those that could be loaded.
        skipped: what the study calls a domain, or a trial -> why it is missing.
        policies: label, seed -> the best policy of the trial, in the order of the trials, where it is at hand.
        figures: label, seed, domain, mode -> `evaluation.FIGURES`, in the order of the trials.
        digests: domain -> `domain_digest`.
        measured: label, seed -> what was measured of a policy that is not at hand.
    """

    domains: list[str]
    skipped: dict[str, str]
    policies: Mapping[tuple[str, int], Policy]
    figures: Mapping[tuple[str, int, str, str], Mapping[str, float]]
    digests: Mapping[str, str] = field(default_factory=dict)
    measured: Mapping[tuple[str, int], Measured] = field(default_factory=dict)

    @property
    def commits(self) -> dict[tuple[str, int], str]:
        """Label, seed -> the source's commit that the policy was trained with, where it is known."""
        found = {key: str(policy.about.get("mlflow.source.git.commit", "")) for key, policy in self.policies.items()}
        found |= {key: measured.commit for key, measured in self.measured.items()}
        return {key: commit for key, commit in found.items() if commit}

    def of(self, label: str, figure: str, mode: str) -> Floats:
        """(n, m): a figure of the n policies of a variant on the m domains."""
        rows = [
            [self.figures[label, seed, domain, mode][figure] for domain in self.domains]
            for trained, seed in dict.fromkeys((label, seed) for label, seed, _, _ in self.figures)
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
    digests = {name: domain_digest(entry) for name, entry in found.items()}
    policies: dict[tuple[str, int], Policy] = {}
    measured: dict[tuple[str, int], Measured] = {}
    figures: dict[tuple[str, int, str, str], Mapping[str, float]] = {}
    for trial in trials:
        if trial.measured is not None:
            if why := unusable(trial.measured, digests, episodes):
                skipped[f"{trial.label}, seed {trial.seed}"] = why
                continue
            measured[trial.label, trial.seed] = trial.measured
            figures |= figures_of(trial, trial.measured, list(found))
            continue
        try:
            policy = policies[trial.label, trial.seed] = Policy.load(trial.policy)
        except PolicyError as error:
            skipped[f"{trial.label}, seed {trial.seed}"] = str(error)
            continue
        note(f"{trial.label}, seed {trial.seed}: {len(found)} domains")
        for name, entry in found.items():
            of_mode = evaluate(policy, entry, episodes, SEED)
            figures |= {(trial.label, trial.seed, name, mode): of_mode[mode] for mode in of_mode}
    return Transfer(list(found), skipped, policies, figures, digests, measured)


def recorded(trials: Sequence[TrialResult], records: StudyRecords) -> Transfer:
    """What records have of each trial on each domain.

    Raises:
        RecordsError: a trial lacks figures.
    """
    measured = {(trial.label, trial.seed): trial.measured for trial in trials if trial.measured is not None}
    figures: dict[tuple[str, int, str, str], Mapping[str, float]] = {}
    for trial in trials:
        if trial.measured is None:
            continue
        if why := unusable(trial.measured, records.domains, records.episodes):
            raise RecordsError(f"records of {records.name}: {trial.label}, seed {trial.seed}: {why}: take another copy")
        figures |= figures_of(trial, trial.measured, list(records.domains))
    return Transfer(list(records.domains), dict(records.skipped), {}, figures, records.domains, measured)


def unusable(measured: Measured, digests: Mapping[str, str], episodes: int) -> str:
    """Why recorded figures do not stand for those on domains of these digests; empty where they do."""
    for name, digest in digests.items():
        figures = measured.figures.get(name, {})
        if any(metric(mode, figure) not in figures for mode in MODES for figure in FIGURES):
            return f"its records have no figures on {name}, and its policy is not at hand"
        if measured.digests.get(name) != digest:
            return f"its records are of another domain called {name}, and its policy is not at hand"
    if digests and measured.episodes != episodes:
        return f"its records are of {measured.episodes} episodes, not {episodes}, and its policy is not at hand"
    return ""


def figures_of(
    trial: TrialResult, measured: Measured, domains: Sequence[str]
) -> dict[tuple[str, int, str, str], Mapping[str, float]]:
    """Recorded figures as `Transfer.figures` has them."""
    return {
        (trial.label, trial.seed, name, mode): {
            figure: measured.figures[name][metric(mode, figure)] for figure in FIGURES
        }
        for name in domains
        for mode in MODES
    }


def domain_digest(entry: Source) -> str:
    """Twelve hexadecimal digits of a domain; of an endless supply its name."""
    if not isinstance(entry, Domain):
        return entry.name
    found = hashlib.sha256()
    for array, kind in ((entry.points, "<f8"), (entry.ring, "<i8"), (entry.segments, "<i8")):
        found.update(np.ascontiguousarray(array, dtype=kind).tobytes())
    return found.hexdigest()[:12]


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
