"""The meshes that the best policy of each variant cuts of the study's domains."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from envs.domains.load import Source
from envs.mesh import Mesh
from envs.types import Domain
from freemesh_ray.formatting.markdown import escaped
from freemesh_ray.plots import caption
from freemesh_ray.policies.evaluation import run_episodes
from freemesh_ray.policies.policy import Policy
from freemesh_ray.report import mesh_picture
from freemesh_ray.report.sections import Picture
from freemesh_ray.report.transfer import SEED, Transfer, load_domains
from freemesh_ray.report.variants import VariantResult


def draw(
    folder: Path, variants: Sequence[VariantResult], evaluated: Transfer, domains: Sequence[str]
) -> dict[str, dict[str, str]]:
    """Cut every mesh and write its picture.

    Args:
        folder: that they are written to.
        variants: of the study.
        evaluated: with their policies.
        domains: as the study names them.

    Returns:
        Domain -> file's name -> description; empty without policies or domains.
    """
    chosen = {variant.label: best_seed(variant, evaluated.policies) for variant in variants}
    best = {label: seed for label, seed in chosen.items() if seed is not None}
    found: dict[str, dict[str, str]] = {}
    entries = load_domains(domains)[0] if best else {}
    for i, (name, entry) in enumerate(entries.items(), start=1):
        found[name] = {}
        for j, (label, seed) in enumerate(best.items(), start=1):
            mesh, title = cut(evaluated.policies[label, seed], entry), f"{label}, seed {seed}"
            file = f"mesh-{i}-{j}.svg"
            mesh_picture.write(folder / file, mesh, title)
            found[name][file] = f"mesh of {name} by {title}: {'; '.join(caption(mesh).splitlines())}"
    return found


def best_seed(variant: VariantResult, policies: Mapping[tuple[str, int], Policy]) -> int | None:
    """The seed with the highest final metric among those that left a policy; None without any."""
    scored = zip(variant.finals[variant.metric], variant.used, strict=True)
    known = [(score, trial.seed) for score, trial in scored if (variant.label, trial.seed) in policies]
    return max(known, key=lambda one: (one[0] == one[0], one[0]))[1] if known else None


def cut(policy: Policy, entry: Source) -> Mesh:
    """What a deterministic episode cuts of a domain; of an endless supply, of its first unseen one."""
    domain = entry if isinstance(entry, Domain) else entry.held_out(1)[0]
    return run_episodes(policy, domain, 1, stochastic=False, seed=SEED)[0].mesh


def section(found: Mapping[str, Mapping[str, str]], by: str, picture: Picture) -> str:
    """The pictures, domain by domain; empty when there are none."""
    if not found:
        return ""
    parts = [
        "## Meshes",
        f"Of each variant the policy of the seed with the highest {by}, in one deterministic episode. Colour is "
        "element quality η, from 0, violet, to 1, yellow; orange dots are interior nodes of fewer than four edges, "
        "pink squares of more; a red line is the front of a mesh that was not completed.",
    ]
    for domain, files in found.items():
        parts += [f"### {escaped(domain)}", "\n".join(picture(file, described(what)) for file, what in files.items())]
    return "\n\n".join(parts)


def described(text: str) -> str:
    """Text of any origin as the description of a picture, in Markdown."""
    return re.sub(r"[\[\]]", lambda found: f"\\{found[0]}", escaped(text))
