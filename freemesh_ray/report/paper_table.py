"""The paper's own tables for studies whose variants are the paper's, by their names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from envs.domains.load import load
from freemesh_ray.paper_tables.density import density
from freemesh_ray.paper_tables.observation import observation
from freemesh_ray.paper_tables.published import published
from freemesh_ray.policies.policy import Policy
from freemesh_ray.report.learning import RETURN, Learning

#: The paper's test: ten repetitions on T1.
DOMAIN, EPISODES = "T1", 10

SEED = (
    "One policy stands for each variant: of several seeds the one with the median final return, of an even number the "
    "lower middle"
)


def paper_table(variants: Sequence[Learning], policies: Mapping[tuple[str, int], Policy]) -> str:
    """The observation or density table, measured with the trained policies; empty when the study is neither."""
    labels = {variant.label for variant in variants}
    makers = {observation: set(published("observation")) - {"source"}, density: set(published("density")["upsilon"])}
    for maker, known in makers.items():
        chosen = {
            variant.label: policies[variant.label, seed]
            for variant in variants
            if (seed := median_seed(variant, policies)) is not None
        }
        if labels <= known and chosen:
            seeds = ", ".join(f"{label} {median_seed(v, policies)}" for v in variants if (label := v.label) in chosen)
            return f"{maker(chosen, load(DOMAIN), EPISODES).strip()}\n\n{SEED}: {seeds}."
    return ""


def median_seed(variant: Learning, policies: Mapping[tuple[str, int], Policy]) -> int | None:
    """The seed of the median final return among those that left a policy; None without any."""
    scored = zip(variant.finals[RETURN], variant.used, strict=True)
    ranked = sorted((score, trial.seed) for score, trial in scored if (variant.label, trial.seed) in policies)
    return ranked[(len(ranked) - 1) // 2][1] if ranked else None
