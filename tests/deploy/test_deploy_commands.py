"""The deployment's command lines are ones that Ray, MLflow and this package understand, and mean what they should."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import manifests
import pytest
from click_lines import mlflow, ray
from manifests import KUBERNETES, README, ROOT, SERVICES, containers, is_secret

from freemesh_ray import config
from freemesh_ray.cli import command as cli
from freemesh_ray.config.paths import Paths
from freemesh_ray.studies import definition as studies

COMMANDS = manifests.command_lines()
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of what Ray and MLflow import


def of(program: str, *rest: str) -> list[Any]:
    """The command lines that begin so, as parameters of a test."""
    begin = [program, *rest]
    return [pytest.param(words, id=place) for place, words in COMMANDS.items() if words[: len(begin)] == begin]


@pytest.fixture
def in_a_cluster(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[str, str]:
    """What a job inherits of its node, but that the shared volume is a folder of this test."""
    told = dict(SERVICES["worker"]["environment"])
    told["FREEMESH_HOME"] = f"{tmp_path}{told['FREEMESH_HOME']}"
    for name in ("FREEMESH_HOME", "MLFLOW_TRACKING_URI"):
        monkeypatch.setenv(name, told[name])
    return told


def check_job(words: Sequence[str], told: Mapping[str, str]) -> None:
    """A training or a study: valid, kept and tracked where the cluster does that, and going on when begun."""
    assert words[:3] == ["python", "-m", "freemesh_ray"]
    options = cli.parser().parse_args(words[3:])
    if options.command == "study":
        assert cli.main([*words[3:], "--dry-run"]) == 0
        settings = studies.load(options.study, options.set).settings_of_all()
    else:
        assert options.command == "train"
        settings = config.load(options.config, options.set)
    assert options.resume
    resolved = Paths.from_environment().resolved(settings)
    assert resolved["paths"] == {name: f"{told['FREEMESH_HOME']}/{name}" for name in ("runs", "studies")}
    assert resolved["tracking"]["uri"] == told["MLFLOW_TRACKING_URI"]


def test_every_command_line_is_one_of_these() -> None:
    assert {words[0] for words in COMMANDS.values()} == {"ray", "mlflow", "python", "freemesh"}
    assert {place.split()[0] for place in COMMANDS} == {"compose", "base", "job", "README", "image"}


@pytest.mark.parametrize("words", of("ray", "start"))
def test_ray_nodes_start(words: list[str]) -> None:
    assert ray(words).command.name == "start"


@pytest.mark.parametrize("words", of("ray", "job"))
def test_jobs_are_submitted_through_loopback(words: list[str], in_a_cluster: dict[str, str]) -> None:
    context = ray(words)
    assert context.command.name == "submit"
    assert context.params["address"] == "http://127.0.0.1:8265"
    check_job(list(context.params["entrypoint"]), in_a_cluster)


@pytest.mark.slow
@pytest.mark.parametrize("words", of("python"))
def test_jobs_are_valid(words: list[str], in_a_cluster: dict[str, str]) -> None:
    check_job(words, in_a_cluster)


@pytest.mark.parametrize("words", of("mlflow", "server"))
def test_mlflow_answers_to_the_name_that_jobs_use(words: list[str]) -> None:
    options = mlflow(words).params
    assert {"mlflow:5000", "localhost:5000", "127.0.0.1:5000"} == set(options["allowed_hosts"].split(","))
    assert options["serve_artifacts"]
    assert options["artifacts_destination"] == "/artifacts"
    assert (options["host"], options["port"]) == ("0.0.0.0", 5000)
    assert options["app_name"] == "basic-auth"


@pytest.mark.parametrize("words", of("mlflow", "db"))
def test_mlflow_upgrades_the_database_that_it_serves(words: list[str]) -> None:
    (server, *others) = (mlflow(parameters.values[0]).params for parameters in of("mlflow", "server"))
    context = mlflow(words)
    assert context.command.name == "upgrade"
    assert context.params["url"] == server["backend_store_uri"]
    assert all(other["backend_store_uri"] == server["backend_store_uri"] for other in others)


def test_kubernetes_runs_what_compose_runs() -> None:
    """The same MLflow, the same health checks, and what jobs inherit."""
    assert COMMANDS["base mlflow"] == COMMANDS["compose mlflow"]
    made = {container["name"]: container for container in containers(manifests.base())}
    assert made["postgres"]["readinessProbe"]["exec"]["command"] == SERVICES["postgres"]["healthcheck"]["test"][1:]
    url = SERVICES["mlflow"]["healthcheck"]["test"][-1]
    assert url.endswith(f":5000{made['mlflow']['readinessProbe']['httpGet']['path']}")
    for service, pod in (("worker", "ray-worker"), ("head", "ray-head"), ("mlflow", "mlflow")):
        # Ray's own two are the operator's to set.
        told = {key: value for key, value in SERVICES[service]["environment"].items() if not key.startswith("RAY_")}
        set_there = {variable["name"]: variable.get("value") for variable in made[pod]["env"]}
        assert set_there == {key: None if is_secret(key) else value for key, value in told.items()}


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
