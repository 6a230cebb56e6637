"""The examples of docs/plug-ins.md: short, and each does in a training what its page says."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from plugged import modules
from processes import ROOT

from envs.plug_ins import search_path
from freemesh_ray import config
from freemesh_ray.algorithms.build import build
from freemesh_ray.config import algorithm_name
from freemesh_ray.local_ray import local_ray
from freemesh_ray.training.job import train

pytestmark = pytest.mark.slow

FOLDER = ROOT / "docs" / "examples" / "plug_ins"
EXAMPLES = sorted(FOLDER.glob("*.py"))
TINY = {
    "name": "examples", "tracking.enabled": False, "runners.count": 0, "runners.envs_per_runner": 4,
    "learner.hidden": [16], "learner.batch_size": 32, "learner.buffer_size": 2000, "learner.warmup_steps": 200,
    "learner.updates_per_step": 0.1, "budget.env_steps": 600, "budget.minutes": None, "evaluation.interval": 10**6,
    "evaluation.episodes": 1, "env.max_invalid": 10,
}  # fmt: skip


@pytest.fixture(autouse=True)
def folder(tmp_path: Path) -> Iterator[None]:
    with modules(tmp_path):
        search_path.look_in(FOLDER)
        yield


def settings(example: Path) -> str:
    """The settings that an example's first lines show."""
    return example.read_text().split('"""')[1].split("\n", 2)[2]


def test_there_is_one_of_each_kind() -> None:
    keys = {key for example in EXAMPLES for key in config.flatten(yaml.safe_load(settings(example)))}
    ours = {key for key in keys if not key.startswith("mean_critics.")}
    env, others = {"env.reward", "env.observe", "env.wrappers"}, {"curriculum.stages", "evaluation.metrics"}
    assert ours == env | others | {"algorithm", "callbacks"}
    assert len(EXAMPLES) == 7


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_and_shown_in_the_docs(example: Path) -> None:
    assert len(example.read_text().splitlines()) < 40
    page = (ROOT / "docs" / "plug-ins.md").read_text()
    assert f"examples/plug_ins/{example.name}" in page


def test_the_examples_train_together(tmp_path: Path) -> None:
    files = []
    for example in EXAMPLES:
        files.append(tmp_path / f"{example.stem}.yaml")
        files[-1].write_text(settings(example))
    tree = config.load([*files, TINY, {"paths.runs": str(tmp_path / "runs")}])
    assert algorithm_name(tree["algorithm"]) == "mean_critics"
    assert tree["mean_critics"]["temperature"] == 0.05
    with local_ray(0):
        run = train(tree, make=build)
    (row,) = run.evaluations
    assert row["eval_deterministic/rectangle/aspect_worst"] >= row["eval_deterministic/rectangle/aspect"] >= 1
    assert run.policy.layers[0][0].shape[0] == 16
    assert str(run.policy.plug_ins) == (
        "env.reward = even_edges:reward, env.observe = front_length:WithFrontLength, env.wrappers = impatient:Impatient"
    )
