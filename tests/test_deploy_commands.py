"""The deployment's command lines are ones that Ray, MLflow and this package understand, and mean what they should."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import click
import manifests
import pytest
from manifests import KUBERNETES, README, ROOT

from freemesh_ray import cli, config
from freemesh_ray.study import definition as studies

COMMANDS = manifests.command_lines()


def click_context(command: click.Command, words: Sequence[str]) -> click.Context:
    """What click understands of a command line; nothing is run.

    Raises:
        click.UsageError: it does not understand it.
    """
    context = command.make_context(words[0], list(words[1:]))
    while isinstance(command, click.Group):
        rest = [*getattr(context, "_protected_args", ()), *context.args]
        name, found, rest = command.resolve_command(context, rest)
        assert found is not None
        command, context = found, found.make_context(name, rest, parent=context)
    return context


def ray(words: Sequence[str]) -> click.Context:
    """A command line of Ray, understood."""
    from ray.scripts.scripts import cli as command

    return click_context(command, words)


def mlflow(words: Sequence[str]) -> click.Context:
    """A command line of MLflow, understood."""
    from mlflow.cli import cli as command

    return click_context(command, words)


def of(program: str, *rest: str) -> list[Any]:
    """The command lines that begin so, as parameters of a test."""
    begin = [program, *rest]
    return [pytest.param(words, id=place) for place, words in COMMANDS.items() if words[: len(begin)] == begin]


def check_job(words: Sequence[str]) -> None:
    """A training or a study: valid settings, which keep everything where a cluster does, and go on when begun."""
    assert words[:3] == ["python", "-m", "freemesh_ray"]
    options = cli.parser().parse_args(words[3:])
    assert options.command in ("train", "study")
    if options.command == "train":
        settings = config.load(options.config, options.set)
    else:
        settings = studies.load(options.study, options.set).settings_of_all()
    assert options.resume
    assert all(path.startswith("/shared/") for path in settings["paths"].values())
    assert settings["tracking"]["uri"] == "http://mlflow:5000"


def test_every_command_line_is_one_of_these() -> None:
    assert {words[0] for words in COMMANDS.values()} == {"ray", "mlflow", "python", "freemesh"}
    assert {place.split()[0] for place in COMMANDS} == {"compose", "base", "job", "README", "image"}


@pytest.mark.parametrize("words", of("ray", "start"))
def test_ray_nodes_start(words: list[str]) -> None:
    assert ray(words).command.name == "start"


@pytest.mark.parametrize("words", of("ray", "job"))
def test_jobs_are_submitted_through_loopback(words: list[str]) -> None:
    context = ray(words)
    assert context.command.name == "submit"
    assert context.params["address"] == "http://127.0.0.1:8265"
    check_job(list(context.params["entrypoint"]))


@pytest.mark.parametrize("words", of("python"))
def test_jobs_are_valid(words: list[str]) -> None:
    check_job(words)


@pytest.mark.parametrize("words", of("mlflow", "server"))
def test_mlflow_answers_to_the_name_that_jobs_use(words: list[str]) -> None:
    options = mlflow(words).params
    assert {"mlflow:5000", "localhost:5000", "127.0.0.1:5000"} == set(options["allowed_hosts"].split(","))
    assert options["serve_artifacts"]
    assert options["artifacts_destination"] == "/artifacts"
    assert (options["host"], options["port"]) == ("0.0.0.0", 5000)


@pytest.mark.parametrize("words", of("mlflow", "db"))
def test_mlflow_upgrades_the_database_that_it_serves(words: list[str]) -> None:
    (server, *others) = (mlflow(parameters.values[0]).params for parameters in of("mlflow", "server"))
    context = mlflow(words)
    assert context.command.name == "upgrade"
    assert context.params["url"] == server["backend_store_uri"]
    assert all(other["backend_store_uri"] == server["backend_store_uri"] for other in others)


def test_the_image_says_what_it_does() -> None:
    (parameters,) = of("freemesh")
    with pytest.raises(SystemExit, match="0"):
        cli.parser().parse_args(parameters.values[0][1:])


def test_readme_names_what_is_there() -> None:
    words = [word for line in manifests.readme_lines() for word in line]
    paths = [word for word in words if word.startswith("deploy/") and ".env" not in word]
    paths += [f"deploy/{link}" for link in re.findall(r"\]\(([^)#]+)\)", README)]
    assert len(paths) >= 8
    for path in paths:
        assert (ROOT / path).exists(), path
    for folder in (KUBERNETES / "overlays").iterdir():
        assert f"| `{folder.name}` |" in README
