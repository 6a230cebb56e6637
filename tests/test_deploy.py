"""The deployment holds together: versions, fields, command lines, and what nobody may reach, read or write."""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path
from typing import Any

import click
import jsonschema
import manifests
import pytest
import yaml
from manifests import BUILDS, COMPOSE, DEPLOY, DOCKERFILE, KUBERNETES, README, ROOT, containers, mappings, templates
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from freemesh_ray import cli, config
from freemesh_ray.study import definition as studies

PROJECT = (ROOT / "pyproject.toml").read_text()
SERVICES = COMPOSE["services"]
COMMANDS = manifests.command_lines()
MOUNTED = "/shared"


def pins(path: Path) -> dict[str, str]:
    """The versions of a lock file, all of them exact."""
    lines = [line for line in path.read_text().splitlines() if line and not line.startswith("#")]
    assert all(re.fullmatch(r"[\w.-]+==[\w.]+", line) for line in lines)
    return {canonicalize_name(name): version for name, version in (line.split("==") for line in lines)}


LOCKED = pins(ROOT / "requirements.lock")
ADDED = pins(DEPLOY / "requirements.lock")
VERSION = re.search(r'^version = "(.+)"', PROJECT, re.M)[1]  # type: ignore[index]
IMAGE = f"freemesh-ray:{VERSION}-ray{LOCKED['ray']}"


@pytest.fixture(params=["base", *BUILDS])
def objects(request: pytest.FixtureRequest) -> list[dict[str, Any]]:
    """The Kubernetes objects as written, and as every overlay and job makes them."""
    return manifests.base() if request.param == "base" else manifests.built(request.param)


@pytest.fixture(params=[build for build in BUILDS if build.startswith("jobs/")])
def job(request: pytest.FixtureRequest) -> dict[str, Any]:
    """What a RayJob, or every one of a RayCronJob, is told."""
    (made,) = manifests.built(request.param)
    return dict(made["spec"].get("jobTemplate", made["spec"]))


# Files and fields


@pytest.mark.parametrize("path", sorted(DEPLOY.rglob("*.yaml")), ids=lambda path: str(path.relative_to(DEPLOY)))
def test_every_file_parses(path: Path) -> None:
    for document in manifests.documents(path):
        assert isinstance(document, dict)
        for patch in document.get("patches", ()):
            assert yaml.safe_load(patch["patch"]) if "patch" in patch else (path.parent / patch["path"]).is_file()


def test_objects_have_only_known_fields(objects: list[dict[str, Any]]) -> None:
    """Nor any that opens the cluster: hostPath, hostNetwork, privileged, NodePort, Ingress are not among them."""
    for made in objects:
        manifests.check("kubernetes.yaml", f"{made['kind']}Object").validate(made)


def test_compose_has_only_known_fields() -> None:
    written = {key: value for key, value in COMPOSE.items() if not key.startswith("x-")}
    manifests.check("compose.yaml", "ComposeObject").validate(written)


def test_a_misspelt_field_is_found() -> None:
    (cluster,) = [made for made in manifests.base() if made["kind"] == "RayCluster"]
    security = containers(cluster)[0]["securityContext"]
    security["readOnlyRootFileSystem"] = security.pop("readOnlyRootFilesystem")
    with pytest.raises(jsonschema.ValidationError, match="readOnlyRootFileSystem"):
        manifests.check("kubernetes.yaml", "RayClusterObject").validate(cluster)


def test_objects_match_the_published_schemas(objects: list[dict[str, Any]]) -> None:
    """Where kubernetes-validate, which carries them, is installed."""
    kubernetes_validate = pytest.importorskip("kubernetes_validate")
    pods = [{"apiVersion": "v1", "kind": "Pod", "metadata": {"name": "any"}, **pod} for pod in templates(objects)]
    for made in pods + [made for made in objects if made["apiVersion"] != "ray.io/v1"]:
        kubernetes_validate.validate({**made, "metadata": {"name": "any", **made["metadata"]}}, "1.35", strict=True)


# Versions


def test_one_version_of_ray() -> None:
    """A driver and its cluster must have the same: the lock's, the image's, the operator's."""
    (cluster,) = [made for made in manifests.base() if made["kind"] == "RayCluster"]
    assert cluster["spec"]["rayVersion"] == LOCKED["ray"]
    assert {service["image"] for name, service in SERVICES.items() if name != "postgres"} == {IMAGE}
    assert set(re.findall(r"freemesh-ray:[\w.-]+", README + DOCKERFILE)) == {IMAGE}


def test_images_are_tagged_alike() -> None:
    """The base's tags are Compose's, and every image has one of them."""
    tags = {
        entry["name"]: entry["newTag"]
        for entry in manifests.documents(KUBERNETES / "base/kustomization.yaml")[0]["images"]
    }
    assert {f"{name}:{tag}" for name, tag in tags.items()} == {service["image"] for service in SERVICES.values()}
    assert {container["image"] for container in containers(manifests.base())} == set(tags)


def test_built_images_have_their_tag() -> None:
    known = {service["image"] for service in SERVICES.values()}
    for build in BUILDS:
        assert {container["image"] for container in containers(manifests.built(build)) if "image" in container} <= known


def test_locks_do_not_overlap() -> None:
    assert not LOCKED.keys() & ADDED.keys()


def test_every_package_of_the_image_is_pinned() -> None:
    """What pip finds on the way from the package's requirements, followed through what is installed here."""
    named = re.search(r"^dependencies = \[(.*?)^\]", PROJECT, re.M | re.S)[1]  # type: ignore[index]
    left = [*re.findall(r'"(.+)"', named), "ray[default]", "psycopg2-binary", "setuptools"]
    seen: set[tuple[str, str]] = set()
    while left:
        requirement = Requirement(left.pop())
        for extra in requirement.extras or {""}:
            name = canonicalize_name(requirement.name)
            if (name, extra) in seen:
                continue
            seen.add((name, extra))
            assert name in LOCKED or name in ADDED, name
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


# Command lines


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


def settings_of(words: Sequence[str]) -> dict[str, Any] | None:
    """The settings that a command line of this package trains with; None where it does not train."""
    options = cli.parser().parse_args(words)
    if options.command == "train":
        return dict(config.load(options.config, options.set))
    if options.command == "study":
        return dict(studies.load(options.study, options.set).settings_of_all())
    return None


def allowed_hosts() -> list[set[str]]:
    """The names that each MLflow server of the deployment answers to."""
    from mlflow.cli import cli as mlflow

    servers = [words for words in COMMANDS.values() if words[:2] == ["mlflow", "server"]]
    return [set(click_context(mlflow, words).params["allowed_hosts"].split(",")) for words in servers]


@pytest.mark.parametrize("place", COMMANDS)
def test_command_lines_parse(place: str) -> None:
    words = COMMANDS[place]
    if words[0] == "mlflow":
        from mlflow.cli import cli as mlflow

        assert click_context(mlflow, words).command.name in ("server", "upgrade")
        return
    if words[0] == "ray":
        from ray.scripts.scripts import cli as ray

        context = click_context(ray, words)
        assert context.command.name in ("start", "submit")
        words = list(context.params.get("entrypoint", ()))
    if words[:3] == ["python", "-m", "freemesh_ray"]:
        settings = settings_of(words[3:])
        assert settings is not None
        assert "--resume" in words
        assert all(path.startswith(f"{MOUNTED}/") for path in settings["paths"].values())
        hosts = allowed_hosts()
        assert len(hosts) == 2
        assert all(settings["tracking"]["uri"].removeprefix("http://") in names for names in hosts)
    elif words and words[0] == "freemesh":
        with pytest.raises(SystemExit, match="0"):
            cli.parser().parse_args(words[1:])
    else:
        assert place in ("compose head", "compose worker")


def test_all_kinds_of_command_lines_are_found() -> None:
    assert {place.split()[0] for place in COMMANDS} == {"compose", "base", "job", "README", "image"}
    assert len(COMMANDS) >= 10


def test_ray_start_parameters_parse(objects: list[dict[str, Any]]) -> None:
    from ray.scripts.scripts import cli as ray

    for mapping in mappings(objects):
        if "rayStartParams" in mapping:
            options = [f"--{key}={value}" for key, value in mapping["rayStartParams"].items()]
            click_context(ray, ["ray", "start", "--block", *options])


def test_readme_names_what_is_there() -> None:
    words = [word for line in manifests.readme_lines() for word in line]
    paths = [word for word in words if word.startswith("deploy/") and ".env" not in word]
    paths += [f"deploy/{link}" for link in re.findall(r"\]\(([^)#]+)\)", README)]
    assert len(paths) >= 8
    for path in paths:
        assert (ROOT / path).exists(), path
    for folder in (KUBERNETES / "overlays").iterdir():
        assert f"| `{folder.name}` |" in README


# Secrets


def test_no_secret_is_written_down() -> None:
    for path in [path for path in DEPLOY.rglob("*") if path.is_file() and path.name != ".env"]:
        text = path.read_text()
        assert not re.search(r"kind: Secret|secretGenerator|stringData", text), path
        assert not re.search(r"://[^/\s:@]+:[^/\s@]+@", text), path
        assert not re.search(r"\b[0-9a-f]{32,}\b", text), path


def is_secret(name: str) -> bool:
    """Whether a variable of that name holds a secret."""
    return bool(re.search("PASSWORD|TOKEN|SECRET|KEY", name))


def test_secrets_are_referred_to(objects: list[dict[str, Any]]) -> None:
    """And the README says how to make each."""
    referred = {(m["authOptions"]["secretName"], "auth_token") for m in mappings(objects) if "authOptions" in m}
    for container in containers(objects):
        for variable in container.get("env", ()):
            assert ("valueFrom" in variable) == is_secret(variable["name"])
            if "valueFrom" in variable:
                reference = variable["valueFrom"]["secretKeyRef"]
                referred.add((reference["name"], reference["key"]))
    assert referred
    for name, key in referred:
        assert f'create secret generic {name} --from-literal={key}="$(openssl rand -hex 32)"' in README


def test_compose_takes_secrets_from_the_environment() -> None:
    for service in SERVICES.values():
        for name, value in service["environment"].items():
            if is_secret(name):
                assert (match := re.fullmatch(r"\$\{(\w+):\?.+\}", value))
                assert match[1] in README
    assert (DEPLOY / ".gitignore").read_text().splitlines() == [".env"]


# What nobody may reach


def test_compose_publishes_on_loopback_only() -> None:
    published = [port for service in SERVICES.values() for port in service.get("ports", ())]
    assert sorted(published) == ["127.0.0.1:5000:5000", "127.0.0.1:8265:8265"]
    assert all("network_mode" not in service for service in SERVICES.values())
    assert SERVICES["postgres"]["networks"] == ["database"]
    assert COMPOSE["networks"]["database"] == {"internal": True}


def test_ray_asks_for_a_token(objects: list[dict[str, Any]]) -> None:
    for mapping in mappings(objects):
        if "headGroupSpec" in mapping:
            assert mapping["authOptions"]["mode"] == "token"
    for name in ("head", "worker"):
        assert SERVICES[name]["environment"]["RAY_AUTH_MODE"] == "token"
        assert "RAY_AUTH_TOKEN" in SERVICES[name]["environment"]
    assert re.search(r"^ +RAY_AUTH_MODE=token", DOCKERFILE, re.M)


def test_the_network_is_closed_but_for_named_peers() -> None:
    policies = [made for made in manifests.base() if made["kind"] == "NetworkPolicy"]
    (closed,) = [policy for policy in policies if policy["metadata"]["name"] == "default-deny"]
    assert closed["spec"] == {"podSelector": {}, "policyTypes": ["Ingress", "Egress"]}
    for policy in policies:
        for rule in policy["spec"].get("ingress", []):
            for peer in rule["from"]:
                assert peer["podSelector"]["matchLabels"], "an ingress names the pods it is for"
                assert "namespaceSelector" not in peer or rule["ports"] == [{"protocol": "TCP", "port": 8265}]
        for rule in policy["spec"].get("egress", []):
            assert all("ipBlock" not in peer for peer in rule["to"])


@pytest.mark.parametrize("build", [build for build in BUILDS if build.startswith("overlays/")])
def test_the_api_server_is_for_the_autoscaler(build: str) -> None:
    """Its way there, and a service account's token, has only the head that autoscales."""
    objects = manifests.built(build)
    (cluster,) = [made for made in objects if made["kind"] == "RayCluster"]
    scaled = cluster["spec"].get("enableInTreeAutoscaling", False)
    head = cluster["spec"]["headGroupSpec"]["template"]
    trusted = [pod for pod in templates(objects) if pod["spec"]["automountServiceAccountToken"]]
    assert trusted == ([head] if scaled else [])
    open_to = [policy for policy in objects if any("ipBlock" in mapping for mapping in mappings(policy))]
    assert [policy["spec"]["podSelector"]["matchLabels"] for policy in open_to] == (
        [{"app.kubernetes.io/component": "ray", "ray.io/node-type": "head"}] if scaled else []
    )


# What nobody may do


def test_pods_are_locked_down(objects: list[dict[str, Any]]) -> None:
    for pod in templates(objects):
        security = pod["spec"]["securityContext"]
        assert security["runAsNonRoot"] is True
        assert security["runAsUser"] > 0
        assert security["runAsGroup"] > 0
        assert security["seccompProfile"] == {"type": "RuntimeDefault"}
        assert pod["spec"]["enableServiceLinks"] is False
    for container in containers(objects):
        assert container["securityContext"] == {
            "allowPrivilegeEscalation": False,
            "readOnlyRootFilesystem": True,
            "capabilities": {"drop": ["ALL"]},
        }
        assert "/tmp" in {mount["mountPath"] for mount in container["volumeMounts"]}


def test_the_namespace_refuses_other_pods() -> None:
    (namespace,) = [made for made in manifests.base() if made["kind"] == "Namespace"]
    assert namespace["metadata"]["labels"]["pod-security.kubernetes.io/enforce"] == "restricted"


@pytest.mark.parametrize("name", SERVICES)
def test_compose_services_are_locked_down(name: str) -> None:
    service = SERVICES[name]
    assert all(int(number) > 0 for number in service["user"].split(":"))
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert any(mount.startswith("/tmp:") for mount in service["tmpfs"])


def quantity(text: str) -> float:
    """A Kubernetes quantity as a number: CPUs or bytes."""
    scales = {"": 1.0, "m": 1e-3, "Mi": 2.0**20, "Gi": 2.0**30}
    number, unit = re.fullmatch(r"([\d.]+)(\D*)", text).groups()  # type: ignore[union-attr]
    return float(number) * scales[unit]


def test_containers_ask_for_no_more_than_they_may_use(objects: list[dict[str, Any]]) -> None:
    for container in containers(objects):
        asked, most = container["resources"]["requests"], container["resources"]["limits"]
        assert asked.keys() == most.keys() >= {"cpu", "memory"}
        assert all(0.0 < quantity(asked[name]) <= quantity(most[name]) for name in asked)


# What must fit together


def test_selectors_claims_and_mounts_meet() -> None:
    objects = manifests.base()
    pods = [pod["metadata"]["labels"].items() for pod in templates(objects)]
    own = "app.kubernetes.io/component"
    for mapping in mappings(objects):
        labels = mapping.get("matchLabels", mapping.get("selector", {}))
        if own in labels:
            assert any(labels.items() <= pod for pod in pods), labels
    claims = {made["metadata"]["name"] for made in objects if made["kind"] == "PersistentVolumeClaim"}
    for made in objects:
        for pod in templates(made):
            volumes = {volume["name"] for volume in pod["spec"]["volumes"]}
            volumes |= {claim["metadata"]["name"] for claim in made["spec"].get("volumeClaimTemplates", ())}
            for container in pod["spec"]["containers"]:
                assert {mount["name"] for mount in container["volumeMounts"]} <= volumes
            for volume in pod["spec"]["volumes"]:
                assert volume.get("persistentVolumeClaim", {"claimName": "shared"})["claimName"] in claims


def test_compose_names_meet() -> None:
    for service in SERVICES.values():
        assert set(service["networks"]) <= COMPOSE["networks"].keys()
        assert {mount.split(":")[0] for mount in service["volumes"]} <= COMPOSE["volumes"].keys()
        assert service.get("depends_on", {}).keys() <= SERVICES.keys()


def test_every_ray_pod_sees_runs_and_studies(objects: list[dict[str, Any]]) -> None:
    for mapping in mappings(objects):
        if "rayStartParams" in mapping:
            for container in containers(mapping):
                assert MOUNTED in {mount["mountPath"] for mount in container["volumeMounts"]}
    for name in ("head", "worker"):
        assert f"shared:{MOUNTED}" in SERVICES[name]["volumes"]


def test_everything_is_in_the_namespace() -> None:
    for build in BUILDS:
        for made in manifests.built(build):
            assert made["kind"] == "Namespace" or made["metadata"]["namespace"] == "freemesh"


@pytest.mark.parametrize(
    ("overlay", "mode"), [("laptop", "ReadWriteOnce"), ("server", "ReadWriteOnce"), ("cluster", "ReadWriteMany")]
)
def test_storage_is_shared_as_far_as_the_machines_are_apart(overlay: str, mode: str) -> None:
    (shared,) = [made for made in manifests.built(f"overlays/{overlay}") if made["metadata"]["name"] == "shared"]
    assert shared["spec"]["accessModes"] == [mode]


def test_a_training_fits_every_overlay() -> None:
    """The learner and its env runners each take a CPU of the workers, as Ray counts them: the limits."""
    needed = 1 + config.load(["train_default.yaml"], [])["runners"]["count"]
    for build in BUILDS:
        for mapping in mappings(manifests.built(build)):
            for group in mapping.get("workerGroupSpecs", ()):
                cpus = sum(quantity(container["resources"]["limits"]["cpu"]) for container in containers(group))
                assert group["minReplicas"] <= group["replicas"] <= group["maxReplicas"]
                assert cpus * group["replicas"] >= needed, build
    assert int(manifests.expanded(SERVICES["worker"]["deploy"]["resources"]["limits"]["cpus"])) >= needed


# Jobs


def test_jobs_end_and_clean_up(job: dict[str, Any]) -> None:
    assert job["shutdownAfterJobFinishes"] is True
    assert 0 < job["ttlSecondsAfterFinished"] <= 3600
    assert job["activeDeadlineSeconds"] > 0
    assert job["backoffLimit"] > 0
    assert "--resume" in job["entrypoint"]


def test_jobs_have_the_clusters_own_pattern(job: dict[str, Any]) -> None:
    """Word for word that of the overlay they name: nothing is written twice."""
    overlays = [made for build in BUILDS if build.startswith("overlays/") for made in manifests.built(build)]
    assert job["rayClusterSpec"] in [made["spec"] for made in overlays if made["kind"] == "RayCluster"]
    assert {container["image"] for container in containers(job["submitterPodTemplate"])} <= {IMAGE} | {None}


def test_the_nightly_job_is_the_study() -> None:
    (nightly,), (study,) = manifests.built("jobs/nightly"), manifests.built("jobs/study")
    assert nightly["kind"] == "RayCronJob"
    assert nightly["spec"]["jobTemplate"] == study["spec"]
    assert re.fullmatch(r"(\S+ ){4}\S+", nightly["spec"]["schedule"])


# The image


def instructions(name: str) -> list[str]:
    """The arguments of a Dockerfile's instruction, continued lines joined."""
    return re.findall(rf"^{name} (.+)$", DOCKERFILE.replace("\\\n", " "), re.M)


def test_the_image_is_built_from_pinned_parts() -> None:
    assert re.fullmatch(r"PYTHON_IMAGE=python:3\.11\.\d+-slim-\w+", instructions("ARG")[0])
    assert instructions("FROM") == ["${PYTHON_IMAGE} AS build", "${PYTHON_IMAGE}"]
    assert re.findall(r"torch==([\d.]+)", DOCKERFILE) == [LOCKED["torch"]]
    assert "TORCH_INDEX=https://download.pytorch.org/whl/cpu" in instructions("ARG")
    installs = [line for line in instructions("RUN") if "pip install" in line]
    assert all("--constraint" in line or "--index-url" in line or "--no-deps" in line for line in installs)


def test_the_image_fetches_nothing_by_hand() -> None:
    assert not instructions("ADD")
    assert not re.search(r"(curl|wget) \S*http|\| *(ba)?sh", DOCKERFILE)
    assert not any(is_secret(line) for line in instructions("ARG") + instructions("ENV"))


def test_the_image_runs_as_the_manifests_say() -> None:
    assert instructions("USER") == [SERVICES["head"]["user"]] == [SERVICES["mlflow"]["user"]]
    assert instructions("ENTRYPOINT") == ['["tini", "-g", "--"]']
    users = {pod["spec"]["securityContext"]["runAsUser"] for pod in templates(manifests.base())}
    assert users == {10001, 999}
    made = re.search(r"install --directory (.+)", DOCKERFILE)[1].split()  # type: ignore[index]
    for service in (SERVICES[name] for name in ("head", "worker", "mlflow")):
        assert {mount.split(":")[1] for mount in service["volumes"]} <= set(made)


def test_the_build_sees_only_what_it_copies() -> None:
    ignored = (DEPLOY / "Dockerfile.dockerignore").read_text().splitlines()
    assert ignored[1] == "*"
    allowed = {line[1:] for line in ignored if line.startswith("!")}
    copied = {source for line in instructions("COPY") if "--from" not in line for source in line.split()[:-1]}
    assert copied == allowed
    assert all((ROOT / source).exists() for source in copied)
