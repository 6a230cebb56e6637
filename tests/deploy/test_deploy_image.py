"""The image is built from pinned parts, from nothing but what it copies, and runs as the manifests say."""

from __future__ import annotations

import configparser
import json
import re
import subprocess
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, requires
from urllib.parse import quote

import manifests
import pytest
from manifests import DEPLOY, DIGEST, DOCKERFILE, LOCKED, LOCKED_DEV, ROOT, SERVICES, is_secret, templates
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
    assert re.fullmatch(rf"PYTHON_IMAGE=python:3\.11\.\d+-slim-\w+{DIGEST}", manifests.instructions("ARG")[0])
    assert manifests.instructions("FROM") == ["${PYTHON_IMAGE} AS build", "${PYTHON_IMAGE}"]
    assert "TORCH_INDEX=https://download.pytorch.org/whl/cpu" in manifests.instructions("ARG")
    installs = [line for line in manifests.instructions("RUN") if "pip install" in line]
    assert len(installs) == 3
    assert all("--require-hashes" in line or "install --no-build-isolation --no-deps . " in line for line in installs)


def test_the_makefile_installs_by_hash_what_is_locked() -> None:
    makefile = (ROOT / "Makefile").read_text()
    installs = re.findall(r"^\t\$\(PIP\) (.+)$", makefile, re.M)
    assert len(installs) == 3
    assert all("--require-hashes" in line or line.startswith("--no-deps --no-build-isolation") for line in installs)
    assert "--requirement requirements.lock --requirement requirements-dev.lock" in makefile
    (torch,) = re.findall(r"sed -n '(.+?)' requirements\.lock", DOCKERFILE)
    assert f"sed -n '{torch.replace('$', '$$')}' requirements.lock" in makefile
    done = subprocess.run(["sed", "-n", torch, ROOT / "requirements.lock"], capture_output=True, text=True, check=True)
    assert re.fullmatch(rf"torch=={LOCKED['torch']}( \\\n    --hash=\S+)+\n", done.stdout)


@pytest.mark.slow
def test_the_locks_hold_all_and_nothing_twice() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert not LOCKED.keys() & LOCKED_DEV.keys()
    assert project["build-system"]["requires"] == [f"setuptools=={LOCKED['setuptools']}"]
    for line in project["project"]["optional-dependencies"]["dev"]:
        assert canonicalize_name(Requirement(line).name) in LOCKED_DEV | LOCKED, line
    for lock in ("requirements.lock", "requirements-dev.lock"):
        assert not re.search(r"^[^#]*(://|index|find-links)", (ROOT / lock).read_text(), re.M)


@pytest.mark.slow
def test_what_is_installed_is_what_is_locked() -> None:
    """The bill of materials of this environment, in CycloneDX's form."""
    line = [sys.executable, "-I", DEPLOY / "bom.py"]
    first, again = (subprocess.run(line, capture_output=True, text=True, check=True).stdout for _ in range(2))
    assert first == again
    bill = json.loads(first)
    assert (bill["bomFormat"], bill["specVersion"], bill["version"]) == ("CycloneDX", "1.6", 1)
    installed = {}
    for each in [bill["metadata"]["component"], *bill["components"]]:
        assert each["type"] in ("library", "application")
        assert each["purl"] == each["bom-ref"] == f"pkg:pypi/{each['name']}@{quote(each['version'])}"
        for told in each.get("licenses", []):
            assert told.keys() == {"expression"} or (told.keys() == {"license"} and told["license"]["name"])
        installed[each["name"]] = each["version"].split("+")[0]  # of torch, how it was built
    references = [each["ref"] for each in bill["dependencies"]]
    assert len(references) == len(set(references)) == len(installed)
    assert {needed for each in bill["dependencies"] for needed in each["dependsOn"]} <= set(references)
    assert installed.pop("freemesh-ray") == tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    installed.pop("pip", None)  # which brings all others
    assert installed == LOCKED | LOCKED_DEV


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
