"""What the README says exists: files, commands, configurations."""

from __future__ import annotations

import re
from pathlib import Path

import gymnasium as gym
import pytest
from checkout import ROOT

import envs  # noqa: F401
from freemesh_ray import config
from freemesh_ray.cli import command as cli
from freemesh_ray.studies import definition as studies

README = (ROOT / "README.md").read_text()


def test_links_lead_somewhere() -> None:
    links = re.findall(r"\]\(([^)#]+)\)", README)
    assert links
    for link in links:
        assert (ROOT / link).exists(), link


def test_commands_parse() -> None:
    commands = re.findall(r"^\.venv/bin/freemesh (.+?)\s*(?:#.*)?$", README, re.M)
    assert len(commands) >= 4
    for command in commands:
        options = cli.parser().parse_args(command.replace("[", "").replace("]", "").split())
        assert options.command in cli.COMMANDS


def test_make_targets_exist() -> None:
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"^make (\w+)", README, re.M):
        assert re.search(rf"^{target}:", makefile, re.M), target


def test_environment_lines_run() -> None:
    (block,) = re.findall(r"```python\n(.*?)```", README, re.S)
    names: dict = {}
    exec(block, names)
    assert isinstance(names["env"], gym.Env)
    assert names["many"].num_envs == 64


@pytest.mark.parametrize("name", sorted(set(config.shipped()) - set(studies.shipped())))
def test_every_shipped_configuration_loads(name: str) -> None:
    assert config.load([] if name == "defaults" else [name])["learner"]["gamma"] == 0.99


def test_the_study_of_one_s_own_is_one(tmp_path: Path) -> None:
    (block,) = re.findall(r"```yaml\n(.*?)```", README, re.S)
    (tmp_path / "mine.yaml").write_text(block)
    study = studies.load(tmp_path / "mine.yaml")
    assert study.trial_config("near", 356)["learner"]["gamma"] == 0.9
    assert study.trial_config("far", 356)["budget"]["env_steps"] == 50_000


def test_the_lock_pins_everything() -> None:
    lines = (ROOT / "requirements.lock").read_text().splitlines()
    assert len(lines) > 50
    assert all(re.fullmatch(r"[A-Za-z0-9_.\-\[\]]+==[^=\s]+", line) for line in lines)
    assert "torch==2.13.0" in lines
