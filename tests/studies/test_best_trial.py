"""Which of a study's trials has the best policy, and what the command says of it."""

from __future__ import annotations

from pathlib import Path

import pytest
from recorded_study import policy

from freemesh_ray.cli.study import _closing
from freemesh_ray.policies.evaluation import COMPLETION, SCORE
from freemesh_ray.policies.policy import Policy
from freemesh_ray.studies.definition import load
from freemesh_ray.studies.returned import StudyResult, TrialResult, best_trial
from freemesh_ray.studies.study_folder import StudyFolder, TrialRecord


def trial(folder: Path, seed: int, score: float, status: str = "finished") -> TrialResult:
    """A trial on disk whose best policy has this score."""
    (folder / f"run-{seed}").mkdir()
    about = {"scores": {SCORE: score, COMPLETION: float(score > 0)}}
    Policy(policy(seed).layers, policy(seed).parameters, about).save(folder / f"run-{seed}" / "policy.npz")
    return result(folder, seed, status)


def result(folder: Path, seed: int, status: str = "finished") -> TrialResult:
    return TrialResult.of(TrialRecord("A", seed, f"run-{seed}", status), StudyFolder(folder))


def test_the_best_trial_has_the_highest_metric_of_those_that_are_over(tmp_path: Path) -> None:
    trials = [trial(tmp_path, 1, 0.2), trial(tmp_path, 2, 0.5), trial(tmp_path, 3, 0.4, "stopped")]
    trials += [trial(tmp_path, 4, 0.9, "failed"), result(tmp_path, 5)]
    best = best_trial(trials, SCORE)
    assert best is trials[1]
    assert best.figures[SCORE] == 0.5
    assert best_trial(trials[3:], SCORE) is None


@pytest.mark.parametrize("score", [0.0, 0.3])
def test_a_best_policy_that_completes_nothing_is_said_to(tmp_path: Path, score: float) -> None:
    only = trial(tmp_path, 1, score)
    told = _closing(StudyResult(StudyFolder(tmp_path), [only], best_trial([only], SCORE)), load("density"))
    assert f"best    A, seed 1: {SCORE} {score:.3f}" in told
    assert ("completes no mesh" in told) == (score == 0.0)
