"""The paper's own tables, measured with the policies of a study whose variants have the paper's names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from envs.domains.load import load
from freemesh_ray.paper_tables.density import density
from freemesh_ray.paper_tables.observation import observation
from freemesh_ray.paper_tables.published import published
from freemesh_ray.policies.evaluation import RETURN
from freemesh_ray.policies.policy import Policy
from freemesh_ray.report.variants import VariantResult

#: The paper's test: ten repetitions on T1.
DOMAIN, EPISODES = "T1", 10

SEED = (
    "One policy stands for each variant: of several seeds the one with the median final return, of an even number the "
    "lower middle"
)


def paper_table(variants: Sequence[VariantResult], policies: Mapping[tuple[str, int], Policy]) -> str:
    """The observation or density table, measured with the trained policies; empty when the study is neither."""
    seeds = {variant.label: median_seed(variant, policies) for variant in variants}
    chosen = {label: seed for label, seed in seeds.items() if seed is not None}
    tables = {observation: set(published("observation")) - {"source"}, density: set(published("density")["upsilon"])}
    for table, labels in tables.items():
        if set(seeds) <= labels and chosen:
            text = table({key[0]: policies[key] for key in chosen.items()}, load(DOMAIN), EPISODES)
            return f"{text.strip()}\n\n{SEED}: {', '.join(f'{label} {seed}' for label, seed in chosen.items())}."
    return ""


def median_seed(variant: VariantResult, policies: Mapping[tuple[str, int], Policy]) -> int | None:
    """The seed of the median final return among those that left a policy; None without any."""
    scored = zip(variant.finals[RETURN], variant.used, strict=True)
    ranked = sorted((score, trial.seed) for score, trial in scored if (variant.label, trial.seed) in policies)
    return ranked[(len(ranked) - 1) // 2][1] if ranked else None
