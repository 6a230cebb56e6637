"""What a training records of an iteration, and that the documents name all of it."""

from __future__ import annotations

import re

from checkout import ROOT

from freemesh_ray.algorithms.env_runner import Episode
from freemesh_ray.config import ALGORITHMS
from freemesh_ray.policies.evaluation import FIGURES
from freemesh_ray.training.metrics import EPISODES, ITERATION, RUNNERS, Iteration, of_iteration

ITERATION_OF = Iteration(stage=2, updates=700, seconds=90.0, new_updates=50, took=4.0)


def test_every_figure_is_under_its_name() -> None:
    ended = [Episode("T1", 60, 10.0, True, 30, 0.5), Episode("T2", 80, 20.0, False, 50, 0.75)]
    learner = {"alpha": 0.1, "critic_loss": 2.0, "unheard_of": 7.0}
    assert of_iteration(
        ITERATION_OF, ended, {"learners": {"default_policy": learner}}, ["alpha", "critic_loss", "entropy"]
    ) == {
        "train/stage": 2,
        "train/updates": 700,
        "train/seconds": 90.0,
        "train/updates_per_second": 12.5,
        "train/return": 15.0,
        "train/completion_rate": 0.5,
        "train/episode_length": 70.0,
        "train/elements": 40.0,
        "train/element_quality": 0.625,
        "learner/alpha": 0.1,
        "learner/critic_loss": 2.0,
    }


def test_without_an_episode_that_ended_there_are_no_means() -> None:
    assert set(of_iteration(ITERATION_OF, [], {}, ["alpha"])) == set(ITERATION)


def test_the_documents_have_every_metric_with_its_unit_and_meaning() -> None:
    text = (ROOT / "docs" / "studies.md").read_text()
    rows = re.findall(r"^\| `((?:train|learner|eval_MODE)/\w+)` \| (.+?) \| (.+?) \|$", text, re.MULTILINE)
    known = {name: (metric.unit, metric.meaning) for name, metric in (ITERATION | RUNNERS | EPISODES).items()}
    learner = {name: about for algorithm in ALGORITHMS.values() for name, about in algorithm.figures.items()}
    for name, (unit, meaning) in learner.items():
        having = [key for key, algorithm in ALGORITHMS.items() if algorithm.figures.get(name) == (unit, meaning)]
        known[f"learner/{name}"] = (unit, f"{', '.join(having)}: {meaning}")
    known |= {f"eval_MODE/{name}": (figure.unit, figure.meaning) for name, figure in FIGURES.items()}
    assert {name: (unit, meaning) for name, unit, meaning in rows} == known
    assert len(rows) == len(known)
