"""Evaluation episodes, with policies made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from envs.domains.load import RandomDomains, from_rings, load
from envs.types import Domain, MeshingParameters
from freemesh_ray.policies import evaluation
from freemesh_ray.policies.evaluation import (
    FIGURES,
    METRICS,
    MODES,
    evaluate,
    evaluation_episodes,
    metric,
    mode_and_figure,
    run_episodes,
    summary,
)
from freemesh_ray.policies.policy import Policy

RING = [(np.cos(t), np.sin(t)) for t in np.linspace(0, 2 * np.pi, 12, endpoint=False)]


def constant(mean: tuple[float, float, float], log_std: float) -> Policy:
    """Acts the same everywhere; ``mean`` before tanh."""
    bias = np.array([*mean, log_std, log_std, log_std], dtype=np.float32)
    return Policy([(np.zeros((15, 6), dtype=np.float32), bias)], MeshingParameters())


#: Draws nearly uniform actions: completes small domains now and then.
WILD = constant((0.0, 0.0, 0.0), 0.3)
#: Always asks for a new vertex on top of V_0: never valid.
STUCK = constant((0.0, -9.0, 0.0), -9.0)


def test_a_deterministic_policy_draws_only_after_a_rejection() -> None:
    results = run_episodes(WILD, from_rings(RING), 4, stochastic=False, seed=0)
    for result in results:
        first = result.mesh.quads[0]
        assert (first == results[0].mesh.quads[0]).all()
    assert len({tuple(result.mesh.quads.ravel()) for result in results}) > 1


def test_the_same_seed_gives_the_same_episodes() -> None:
    runs = [run_episodes(WILD, from_rings(RING), 3, stochastic=True, seed=7) for _ in range(2)]
    for one, other in zip(*runs, strict=True):
        assert one.episode_return == other.episode_return
        np.testing.assert_array_equal(one.mesh.vertices, other.mesh.vertices)


def test_a_stuck_policy_is_truncated_with_nothing_but_penalties() -> None:
    (result,) = run_episodes(STUCK, load("T1"), 1, stochastic=False, seed=0)
    assert not result.completed
    assert result.steps == result.invalid == 100
    assert result.episode_return == pytest.approx(-10.0)
    assert summary([result]) == {
        "return": pytest.approx(-10.0),
        "completion_rate": 0.0,
        "elements": 0.0,
        "element_quality": 0.0,
        "score": 0.0,
        "invalid": 100.0,
    }


def test_figures_are_means_over_episodes_and_a_score_counts_completed_meshes_alone() -> None:
    results = run_episodes(WILD, load("T1"), 20, stochastic=True, seed=1)
    done = [result for result in results if result.completed]
    assert 0 < len(done) < 20
    assert summary(results) == {
        "return": pytest.approx(sum(result.episode_return for result in results) / 20),
        "completion_rate": len(done) / 20,
        "elements": sum(len(result.mesh.quads) for result in results) / 20,
        "element_quality": pytest.approx(sum(result.mean_eta for result in results) / 20),
        "score": pytest.approx(sum(result.mean_eta for result in done) / 20),
        "invalid": sum(result.invalid for result in results) / 20,
    }
    assert [result.score for result in results if not result.completed] == [0.0] * (20 - len(done))


def test_an_evaluation_is_deterministic_and_stochastic() -> None:
    domain = from_rings(RING)
    found = evaluate(WILD, domain, 3, seed=5)
    assert found == {
        "deterministic": summary(run_episodes(WILD, domain, 3, stochastic=False, seed=5)),
        "stochastic": summary(run_episodes(WILD, domain, 3, stochastic=True, seed=5)),
    }
    assert found["deterministic"] != found["stochastic"]


def test_a_metric_s_name_has_its_mode_its_domain_and_its_figure() -> None:
    assert metric("stochastic", "score", "T1") == "eval_stochastic/T1/score"
    assert len(set(METRICS)) == len(MODES) * len(FIGURES)
    assert all(metric(*mode_and_figure(name)) == name for name in METRICS)


def test_counts_add_up() -> None:
    for result in run_episodes(WILD, from_rings(RING), 8, stochastic=True, seed=1):
        accepted = len(result.mesh.quads) - int(result.completed)
        assert result.steps == accepted + result.invalid
        assert 0.0 <= result.mean_eta <= 1.0


def test_an_endless_supply_is_evaluated_on_forty_domains_that_training_never_draws(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[tuple[str, int]] = []

    def episodes(policy: Policy, domain: Domain, count: int, **options: object) -> list[None]:
        asked.append((domain.name, count))
        return [None]

    monkeypatch.setattr(evaluation, "run_episodes", episodes)
    assert len(evaluation_episodes(WILD, RandomDomains(), 10, stochastic=False, seed=0)) == 40
    assert asked == [(f"random-held-out-{i}", 1) for i in range(40)]
