"""Studies on disk that nothing was trained for: curves of a formula, policies of random weights."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from envs.mdp.observation import observation_size
from envs.types import MeshingParameters
from freemesh_ray import config
from freemesh_ray.policies.policy import Policy


def saturating(steps: np.ndarray, end: float, pace: float, noise: float, random: np.random.Generator) -> np.ndarray:
    """Returns that rise from -30 towards ``end`` within some ``pace`` steps."""
    return end - (end + 30.0) * np.exp(-steps / pace) + noise * random.standard_normal(len(steps))


def rows(steps: np.ndarray, returns: np.ndarray, stages: Sequence[str] = ("T1",)) -> list[dict[str, float]]:
    """Lines of evaluations.jsonl with these deterministic returns."""
    found = []
    for step, value in zip(steps.tolist(), returns.tolist(), strict=True):
        done = float(np.clip(np.round((value + 10) / 70, 1), 0, 1))
        row: dict[str, float] = {"env_steps": int(step), "seconds": step / 300}
        for kind, lower in (("deterministic", 0.0), ("stochastic", 4.0)):
            means = {
                "return": value - lower, "completion_rate": done, "elements": 120 + value,
                "element_quality": 0.5 + 0.2 * done, "invalid": 100 - value,
            }  # fmt: skip
            for place in ("", *(f"{stage}/" for stage in stages)):
                row |= {f"eval_{kind}/{place}{name}": number for name, number in means.items()}
        found.append(row)
    return found


def policy(seed: int, **parameters: Any) -> Policy:
    """Random weights; draws almost uniformly, so that a small square is completed now and then."""
    mdp = MeshingParameters(**parameters)
    random = np.random.default_rng(seed)
    weight = 0.05 * random.standard_normal((observation_size(mdp), 2 * mdp.action_size)).astype(np.float32)
    bias = np.repeat(np.float32([0.0, 0.3]), mdp.action_size)
    return Policy([(weight, bias)], mdp, {"mlflow.source.git.commit": "0123456789abcdef0123456789abcdef01234567"})


def write_run(folder: Path, evaluations: Sequence[Mapping[str, Any]], made: Policy | None, sets: Sequence[str]) -> None:
    """A run's folder."""
    folder.mkdir(parents=True)
    (folder / "config.yaml").write_text(config.dump(config.load(sets=sets)))
    (folder / "evaluations.jsonl").write_text("".join(json.dumps(row) + "\n" for row in evaluations))
    if made is not None:
        made.save(folder / "policy.npz")


def write_study(folder: Path, about: Mapping[str, Any], trials: Sequence[Mapping[str, Any]]) -> Path:
    """A study's folder with its description and its list of trials."""
    folder.mkdir(parents=True, exist_ok=True)
    study = {key: value for key, value in about.items() if value}
    tree = {"study": study, "settings": {"curriculum": {"stages": ["T1"]}}}
    (folder / "study.yaml").write_text(yaml.safe_dump(tree, sort_keys=False))
    (folder / "trials.json").write_text(json.dumps(list(trials)))
    return folder


#: Label -> end and pace of its returns.
ALGORITHMS = {"SAC": (62.0, 40e3), "PPO": (25.0, 90e3), "DDPG": (8.0, 60e3), "TD3": (55.0, 55e3)}
SEEDS = (356, 567, 999)
FINDING = "SAC learns fastest and is stable; PPO oscillates; DDPG and TD3 stop early."


def algorithms(
    folder: Path,
    ends: Mapping[str, tuple[float, float]] = ALGORITHMS,
    seeds: Sequence[int] = SEEDS,
    steps: int = 200_000,
    domains: Sequence[str] = ("T1",),
    expects: Sequence[str] = (),
    sets: Mapping[str, Mapping[str, Any]] | None = None,
) -> Path:
    """A finished study of variants, their runs below its folder."""
    trials = []
    for i, (label, (end, pace)) in enumerate(ends.items()):
        for seed in seeds:
            random = np.random.default_rng([seed, i])
            at = np.arange(10_000, steps + 1, 10_000) + random.integers(0, 400)
            found = saturating(at, end * random.uniform(0.94, 1.06), pace * random.uniform(0.8, 1.25), 2.5, random)
            own = (sets or {}).get(label, {})
            made = policy(seed + i, **{key.removeprefix("env."): value for key, value in own.items()})
            write_run(folder / "runs" / f"{label}-{seed}", rows(at, found), made, ["budget.env_steps=200000"])
            trials.append({"label": label, "seed": seed, "run": f"runs/{label}-{seed}", "status": "finished",
                           "error": None, "settings": {}})  # fmt: skip
    about = {
        "title": "Learning efficiency of four algorithms",
        "paper": 'figure "Learning efficiency and performance comparison of various RL algorithms"',
        "finding": FINDING, "expects": list(expects), "variants": {label: dict((sets or {}).get(label, {})) for label in
        ends}, "seeds": list(seeds), "domains": list(domains), "metric": "eval_deterministic/return",
    }  # fmt: skip
    return write_study(folder, about, trials)
