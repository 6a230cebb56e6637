"""The image is built from pinned parts, from nothing but what it copies, and runs as the manifests say."""

from __future__ import annotations

import configparser
import re
import tomllib
from importlib.metadata import PackageNotFoundError, requires

import manifests
from manifests import DEPLOY, DOCKERFILE, LOCKED, ROOT, SERVICES, is_secret, templates
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name


def test_every_package_of_the_image_is_pinned() -> None:
    """What pip finds on the way from the package's requirements, followed through what is installed here."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    left = [*project["dependencies"], *project["optional-dependencies"]["server"]]
    seen: set[tuple[str, str]] = set()
    while left:
        requirement = Requirement(left.pop())
        for extra in requirement.extras or {""}:
            name = canonicalize_name(requirement.name)
            if (name, extra) in seen:
                continue
            seen.add((name, extra))
            assert name in LOCKED, name
            if name == "torch":
                continue  # with what its build needs, from an index of its own
            try:
                needed = requires(name) or []
            except PackageNotFoundError:
                continue
            left += [
                line
                for line in needed
                if (marker := Requirement(line).marker) is None or marker.evaluate({"extra": extra})
            ]


def test_the_image_is_built_from_pinned_parts() -> None:
    assert re.fullmatch(r"PYTHON_IMAGE=python:3\.11\.\d+-slim-\w+", manifests.instructions("ARG")[0])
    assert manifests.instructions("FROM") == ["${PYTHON_IMAGE} AS build", "${PYTHON_IMAGE}"]
    assert re.findall(r"torch==([\d.]+)", DOCKERFILE) == [LOCKED["torch"]]
    assert "TORCH_INDEX=https://download.pytorch.org/whl/cpu" in manifests.instructions("ARG")
    installs = [line for line in manifests.instructions("RUN") if "pip install" in line]
    assert all(re.search(r"--constraint|--no-deps|install (--index-url \S+ )?[\w-]+==\S+$", line) for line in installs)


def test_the_image_fetches_nothing_by_hand() -> None:
    assert not manifests.instructions("ADD")
    assert not re.search(r"(curl|wget) \S*http|\| *(ba)?sh", DOCKERFILE)
    assert not any(is_secret(line) for line in manifests.instructions("ARG") + manifests.instructions("ENV"))


def test_the_image_runs_as_the_manifests_say() -> None:
    assert manifests.instructions("USER") == [SERVICES["head"]["user"]] == [SERVICES["mlflow"]["user"]]
    assert manifests.instructions("ENTRYPOINT") == ['["tini", "-g", "--"]']
    users = {pod["spec"]["securityContext"]["runAsUser"] for pod in templates(manifests.base())}
    assert users == {10001, 999}
    auth = manifests.image_environment()["MLFLOW_AUTH_CONFIG_PATH"]
    assert f"deploy/mlflow_auth.ini {auth}" in manifests.instructions("COPY")
    made = re.search(r"install --directory (.+)", DOCKERFILE)[1].split()
    for service in (SERVICES[name] for name in ("head", "worker", "mlflow")):
        assert {mount.split(":")[1] for mount in service["volumes"]} <= set(made)


def test_the_build_sees_only_what_it_copies() -> None:
    ignored = (DEPLOY / "Dockerfile.dockerignore").read_text().splitlines()
    assert ignored[1] == "*"
    allowed = {line[1:] for line in ignored if line.startswith("!")}
    copied = {source for line in manifests.instructions("COPY") if "--from" not in line for source in line.split()[:-1]}
    assert copied == allowed
    assert all((ROOT / source).exists() for source in copied)


def test_the_login_knows_whom_jobs_log_in_as_and_no_password() -> None:
    login = configparser.ConfigParser()
    login.read(DEPLOY / "mlflow_auth.ini")
    assert login.sections() == ["mlflow"]
    assert login["mlflow"].keys() == {"admin_username", "default_permission", "database_uri"}
    assert login["mlflow"]["admin_username"] == SERVICES["worker"]["environment"]["MLFLOW_TRACKING_USERNAME"]
    assert f"--backend-store-uri={login['mlflow']['database_uri']}" in SERVICES["mlflow"]["command"]
