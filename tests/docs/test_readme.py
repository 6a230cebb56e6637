"""What the README says of configurations and of the lock."""

from __future__ import annotations

from pathlib import Path

import pytest
from documents import blocks

from freemesh_ray import config
from freemesh_ray.studies import definition as studies


@pytest.mark.parametrize("name", sorted(set(config.shipped()) - set(studies.shipped())))
def test_every_shipped_configuration_loads(name: str) -> None:
    assert config.load([] if name == "defaults" else [name]).keys() == config.load().keys()


def test_the_study_of_one_s_own_is_one(tmp_path: Path) -> None:
    (block,) = (block for block in blocks("README.md") if block.language == "yaml")
    (tmp_path / "mine.yaml").write_text(block.text)
    study = studies.load(tmp_path / "mine.yaml")
    assert study.trial_config("near", 356)["learner"]["gamma"] == 0.9
    assert study.trial_config("far", 356)["budget"]["env_steps"] == 50_000
