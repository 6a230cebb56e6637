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
from freemesh_ray.records.measured import Measured, as_recorded
from freemesh_ray.report import mesh_picture
from freemesh_ray.report.sections import Picture
from freemesh_ray.report.transfer import SEED, Transfer, load_domains
from freemesh_ray.report.variants import VariantResult

#: Domain -> variant's label, seed -> mesh.
Cut = dict[str, dict[tuple[str, int], Mesh]]


def of_best(variants: Sequence[VariantResult], evaluated: Transfer, domains: Sequence[str]) -> Cut:
    """The mesh of every domain by each variant's best policy: cut now, or when it was recorded.

    Args:
        variants: of the study.
        evaluated: with their policies, or records of them.
        domains: as the study names them.

    Returns:
        As records keep them; empty without policies or domains.
    """
    chosen = {variant.label: best_seed(variant, evaluated) for variant in variants}
    best = [(label, seed) for label, seed in chosen.items() if seed is not None]
    entries = load_domains(domains)[0] if any(key in evaluated.policies for key in best) else {}
    return {
        name: {
            key: as_recorded(cut(evaluated.policies[key], entries[name]))
            if key in evaluated.policies
            else evaluated.measured[key].meshes[name]
            for key in best
        }
        for name in (evaluated.domains if best else [])
    }


def draw(folder: Path, found: Cut) -> dict[str, dict[str, str]]:
    """Write the picture of every mesh into a folder: domain -> file's name -> description."""
    told: dict[str, dict[str, str]] = {}
    for i, (name, meshes) in enumerate(found.items(), start=1):
        told[name] = {}
        for j, ((label, seed), mesh) in enumerate(meshes.items(), start=1):
            title, file = f"{label}, seed {seed}", f"mesh-{i}-{j}.svg"
            mesh_picture.write(folder / file, mesh, title)
            told[name][file] = f"mesh of {name} by {title}: {'; '.join(caption(mesh).splitlines())}"
    return told


def best_seed(variant: VariantResult, evaluated: Transfer) -> int | None:
    """The seed with the highest final metric among those whose policy, or whose meshes, are there; None without any."""
    there = {
        *evaluated.policies,
        *(key for key, measured in evaluated.measured.items() if complete(measured, evaluated)),
    }
    scored = zip(variant.finals[variant.metric], variant.used, strict=True)
    known = [(score, trial.seed) for score, trial in scored if (variant.label, trial.seed) in there]
    return max(known, key=lambda one: (one[0] == one[0], one[0]))[1] if known else None


def complete(measured: Measured, evaluated: Transfer) -> bool:
    """Whether records have a mesh of every domain."""
    return all(name in measured.meshes for name in evaluated.domains)


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
