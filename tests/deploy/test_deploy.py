"""The deployment holds together: fields, versions, secrets, and what nobody may reach or do."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import kubernetes_validate
import manifests
import pytest
import yaml
from manifests import (
    BUILDS,
    COMPOSE,
    DEPLOY,
    DIGEST,
    DOCKERFILE,
    KUBERNETES,
    LOCKED,
    README,
    ROOT,
    SERVICES,
    containers,
    is_secret,
    mappings,
    templates,
)

from freemesh_ray import config
from freemesh_ray.config.env_runner_count import runner_count

MOUNTED = "/shared"
#: Of the API server: the oldest and the newest that the manifests are checked against.
KUBERNETES_VERSIONS = ("1.32", "1.37")
VERSION = re.search(r'^version = "(.+)"', (ROOT / "pyproject.toml").read_text(), re.M)[1]
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


def native(objects: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """What Kubernetes' own schemas describe: its objects, and of KubeRay's their pods and what goes into them."""
    for made in objects:
        if made["apiVersion"] != "ray.io/v1":
            yield made
            continue
        yield {"apiVersion": "v1", "kind": "ConfigMap", "metadata": made["metadata"]}
        for pod in templates(made):
            yield {"apiVersion": "v1", "kind": "Pod", **pod}
        for options in (mapping["autoscalerOptions"] for mapping in mappings(made) if "autoscalerOptions" in mapping):
            own = {key: options[key] for key in ("resources", "securityContext", "volumeMounts")}
            yield {"apiVersion": "v1", "kind": "Pod", "spec": {"containers": [{"name": "autoscaler", **own}]}}


@pytest.mark.parametrize("version", KUBERNETES_VERSIONS)
def test_objects_match_kubernetes_schemas(objects: list[dict[str, Any]], version: str) -> None:
    for made in native(objects):
        kubernetes_validate.validate(made, version, strict=True)


def test_objects_match_kuberays_fields(objects: list[dict[str, Any]]) -> None:
    for made in objects:
        if made["apiVersion"] == "ray.io/v1":
            manifests.check("kuberay.yaml", f"{made['kind']}Object").validate(made)


@pytest.mark.slow
@pytest.mark.skipif("KUBERAY_CRDS" not in os.environ, reason="KUBERAY_CRDS names no folder of KubeRay's CRD files")
def test_objects_match_kuberays_schemas() -> None:
    """Those of the files ``ray.io_*.yaml`` of a KubeRay release, from its folder ray-operator/config/crd/bases."""
    paths = Path(os.environ["KUBERAY_CRDS"]).glob("ray.io_*.yaml")
    definitions = [document for path in paths for document in manifests.documents(path)]
    checks = {
        crd["spec"]["names"]["kind"]: jsonschema.Draft202012Validator(manifests.closed_schema(crd, "v1"))
        for crd in definitions
    }
    for made in (made for build in BUILDS for made in manifests.built(build)):
        if made["apiVersion"] == "ray.io/v1":
            checks[made["kind"]].validate(made)


def test_a_crds_schema_is_closed() -> None:
    """Unlike the file it is read from: the API server drops what that does not know, without a word."""
    properties = {"kind": {"type": "string"}, "spec": {"type": "object", "properties": {"size": {"type": "integer"}}}}
    version = {"name": "v1", "schema": {"openAPIV3Schema": {"type": "object", "properties": properties}}}
    schema = manifests.closed_schema({"spec": {"versions": [version]}}, "v1")
    jsonschema.validate({"kind": "Any", "spec": {"size": 1}}, schema)
    for wrong in ({"sizes": 1}, {"size": "1"}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate({"kind": "Any", "spec": wrong}, schema)


def test_compose_has_only_known_fields() -> None:
    written = {key: value for key, value in COMPOSE.items() if not key.startswith("x-")}
    manifests.check("compose.yaml", "ComposeObject").validate(written)


@pytest.mark.skipif("COMPOSE_SCHEMA" not in os.environ, reason="COMPOSE_SCHEMA names no file compose-spec.json")
def test_compose_matches_the_specification() -> None:
    schema = json.loads(Path(os.environ["COMPOSE_SCHEMA"]).read_text())
    jsonschema.Draft7Validator(schema).validate(COMPOSE)


def test_a_misspelt_field_is_found() -> None:
    (cluster,) = [made for made in manifests.base() if made["kind"] == "RayCluster"]
    security = containers(cluster)[0]["securityContext"]
    security["readOnlyRootFileSystem"] = security.pop("readOnlyRootFilesystem")
    with pytest.raises(kubernetes_validate.ValidationError, match="readOnlyRootFileSystem"):
        [kubernetes_validate.validate(made, KUBERNETES_VERSIONS[-1], strict=True) for made in native([cluster])]
    cluster["spec"]["authOption"] = cluster["spec"].pop("authOptions")
    with pytest.raises(jsonschema.ValidationError, match="authOption"):
        manifests.check("kuberay.yaml", "RayClusterObject").validate(cluster)


# Versions


def test_one_version_of_ray() -> None:
    """A driver and its cluster must have the same: the lock's, the image's, the operator's."""
    (cluster,) = [made for made in manifests.base() if made["kind"] == "RayCluster"]
    assert cluster["spec"]["rayVersion"] == LOCKED["ray"]
    assert {service["image"] for name, service in SERVICES.items() if name != "postgres"} == {IMAGE}
    assert set(re.findall(r"freemesh-ray:[\w.-]+", README + DOCKERFILE)) == {IMAGE}


def test_images_are_tagged_alike() -> None:
    """The base's tags are Compose's, and every image has one of them."""
    ours, theirs = manifests.documents(KUBERNETES / "base/kustomization.yaml")[0]["images"]
    assert f"{ours['name']}:{ours['newTag']}" == IMAGE
    assert re.fullmatch(rf"{theirs['name']}:[\w.-]+@{theirs['digest']}", SERVICES["postgres"]["image"])
    assert {container["image"] for container in containers(manifests.base())} == {ours["name"], theirs["name"]}


def test_images_of_others_are_pinned_by_digest() -> None:
    for service in SERVICES.values():
        assert service["image"] == IMAGE or re.fullmatch(rf"[\w.:-]+{DIGEST}", service["image"])


def test_built_images_have_their_tag() -> None:
    known = {re.sub(r":[\w.-]+@", "@", service["image"]) for service in SERVICES.values()}
    for build in BUILDS:
        assert {container["image"] for container in containers(manifests.built(build)) if "image" in container} <= known


# Secrets


def test_no_secret_is_written_down() -> None:
    for path in [path for path in DEPLOY.rglob("*") if path.is_file() and path.name != ".env"]:
        text = path.read_text()
        assert not re.search(r"kind: Secret|secretGenerator|stringData", text), path
        assert not re.search(r"://[^/\s:@]+:[^/\s@]+@", text), path
        assert not re.search(r"(?<!sha256:)\b[0-9a-f]{32,}\b", text), path


def test_secrets_are_referred_to(objects: list[dict[str, Any]]) -> None:
    """And the README says how to make each."""
    referred = {(m["authOptions"]["secretName"], "auth_token") for m in mappings(objects) if "authOptions" in m}
    for container in containers(objects):
        for variable in container.get("env", ()):
            assert ("valueFrom" in variable) == is_secret(variable["name"])
            if "valueFrom" in variable:
                reference = variable["valueFrom"]["secretKeyRef"]
                referred.add((reference["name"], reference["key"]))
    made = [line for line in README.splitlines() if " create secret generic " in line]
    for name, key in referred:
        (line,) = [line for line in made if f" generic {name} " in line]
        assert f'--from-literal={key}="$(openssl rand -hex 32)"' in line


def test_compose_takes_secrets_from_the_environment() -> None:
    for service in SERVICES.values():
        for name, value in service["environment"].items():
            if is_secret(name):
                assert (match := re.fullmatch(r"\$\{(\w+):\?.+\}", value))
                assert match[1] in README
    assert (DEPLOY / ".gitignore").read_text().splitlines() == [".env"]


# What nobody may reach


def test_nothing_leaves_its_pod(objects: list[dict[str, Any]]) -> None:
    """Nothing of the node is taken, nothing is published beyond the cluster."""
    plain = {"Namespace", "NetworkPolicy", "PersistentVolumeClaim", "Service", "Deployment", "StatefulSet"}
    assert {made["kind"] for made in objects} <= plain | {"RayCluster", "RayJob", "RayCronJob"}
    closed = {"hostPath", "hostNetwork", "hostPID", "hostIPC", "hostPort", "privileged", "nodePort", "externalIPs"}
    for mapping in mappings(objects):
        assert not closed & mapping.keys()
        assert mapping.get("serviceType", "ClusterIP") == "ClusterIP"
    assert all(made["spec"].get("type", "ClusterIP") == "ClusterIP" for made in objects if made["kind"] == "Service")


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
    assert 100 <= service["pids_limit"] <= 10_000
    assert any(mount.startswith("/tmp:") for mount in service["tmpfs"])


def quantity(text: str) -> float:
    """A Kubernetes quantity as a number: CPUs or bytes."""
    scales = {"": 1.0, "m": 1e-3, "Mi": 2.0**20, "Gi": 2.0**30}
    number, unit = re.fullmatch(r"([\d.]+)(\D*)", text).groups()
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
    needed = 1 + runner_count(config.load(["train_default.yaml"], []))
    for build in BUILDS:
        for mapping in mappings(manifests.built(build)):
            for group in mapping.get("workerGroupSpecs", ()):
                cpus = sum(quantity(container["resources"]["limits"]["cpu"]) for container in containers(group))
                assert group["minReplicas"] <= group["replicas"] <= group["maxReplicas"]
                assert cpus * group["replicas"] >= needed, build
    (slots,) = [word for word in manifests.command_lines()["compose worker"] if word.startswith("--num-cpus=")]
    assert int(slots.removeprefix("--num-cpus=")) >= needed


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
