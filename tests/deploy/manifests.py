"""The deployment as data: its documents, as written and as kustomize builds them, its pods and its command lines."""

from __future__ import annotations

import functools
import re
import shlex
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import jsonschema
import pytest
import yaml
from checkout import ROOT
from packaging.utils import canonicalize_name

#: Compiled where it is there: KubeRay's files have four megabytes.
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

DEPLOY = ROOT / "deploy"
KUBERNETES = DEPLOY / "kubernetes"
README = (DEPLOY / "README.md").read_text()
DOCKERFILE = (DEPLOY / "Dockerfile").read_text()
COMPOSE = yaml.safe_load((DEPLOY / "compose.yaml").read_text())
SERVICES = COMPOSE["services"]
#: What an image of others is pinned by.
DIGEST = "@sha256:[0-9a-f]{64}"

#: What `kubectl apply -k` is given.
BUILDS = sorted(
    str(path.parent.relative_to(KUBERNETES))
    for folder in ("overlays", "jobs")
    for path in (KUBERNETES / folder).rglob("kustomization.yaml")
)


def pins(path: Path) -> dict[str, str]:
    """The versions of a lock file, all of them exact and with the hashes of their files."""
    text = "".join(line for line in path.read_text().splitlines(keepends=True) if not line.startswith("#"))
    entries = re.findall(r"([\w.-]+)==([\w.]+)((?: \\\n    --hash=sha256:[0-9a-f]{64})+)\n", text)
    assert "".join(f"{name}=={version}{hashes}\n" for name, version, hashes in entries) == text
    return {canonicalize_name(name): version for name, version, _ in entries}


LOCKED, LOCKED_DEV = pins(ROOT / "requirements.lock"), pins(ROOT / "requirements-dev.lock")


def is_secret(name: str) -> bool:
    """Whether a variable of that name holds a secret."""
    return bool(re.search("PASSWORD|TOKEN|SECRET|KEY", name))


def documents(path: Path) -> list[Any]:
    """The documents of a YAML file."""
    return list(yaml.load_all(path.read_text(), LOADER))


def base() -> list[dict[str, Any]]:
    """The objects of the base as they are written: images without tags, no namespace."""
    listed = documents(KUBERNETES / "base" / "kustomization.yaml")[0]["resources"]
    return [document for name in listed for document in documents(KUBERNETES / "base" / name)]


@functools.cache
def built(folder: str) -> list[dict[str, Any]]:
    """The objects that a folder of ``kubernetes`` amounts to; the test is skipped where nothing builds them."""
    builder = ["kubectl", "kustomize"] if shutil.which("kubectl") else ["kustomize", "build"]
    if not shutil.which(builder[0]):
        pytest.skip("neither kubectl nor kustomize is installed")
    done = subprocess.run([*builder, str(KUBERNETES / folder)], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return list(yaml.load_all(done.stdout, LOADER))


def mappings(node: Any) -> Iterator[dict[str, Any]]:
    """Every mapping within, the node itself first."""
    if isinstance(node, dict):
        yield node
    for child in node.values() if isinstance(node, dict) else node if isinstance(node, list) else ():
        yield from mappings(child)


def templates(node: Any) -> list[dict[str, Any]]:
    """Every pod template within."""
    return [mapping for mapping in mappings(node) if "containers" in mapping.get("spec", ())]


def containers(node: Any) -> list[dict[str, Any]]:
    """Every container within, and what is told of the autoscaler's, which the operator makes."""
    made = [container for template in templates(node) for container in template["spec"]["containers"]]
    return made + [mapping["autoscalerOptions"] for mapping in mappings(node) if "autoscalerOptions" in mapping]


def expanded(text: str, values: Mapping[str, str] = MappingProxyType({})) -> str:
    """Compose's interpolation: of ``${NAME:-default}`` and ``${NAME:?message}`` the value, else what stands there."""
    return re.sub(r"\$\{(\w+):[-?]([^}]*)\}", lambda match: values.get(match[1], match[2]), text)


def required_variables() -> set[str]:
    """What compose.yaml does not start without."""
    return set(re.findall(r"\$\{(\w+):\?", (DEPLOY / "compose.yaml").read_text()))


def instructions(name: str) -> list[str]:
    """The arguments of a Dockerfile's instruction, continued lines joined."""
    return re.findall(rf"^{name} (.+)$", DOCKERFILE.replace("\\\n", " "), re.M)


def image_environment() -> dict[str, str]:
    """The variables that the image sets, but PATH."""
    pairs = [pair.split("=", 1) for pair in shlex.split(instructions("ENV")[-1])]
    return {name: value for name, value in pairs if name != "PATH"}


def readme_lines() -> list[list[str]]:
    """The shell lines of the README's blocks, split into words, with the variables that the README sets."""
    blocks = re.findall(r"^ *```sh\n(.*?)^ *```", README, re.M | re.S)
    lines = [line.strip() for block in blocks for line in block.splitlines()]
    variables = dict(match.groups() for line in lines if (match := re.fullmatch(r'([A-Z]+)="(.*)"', line)))
    for name, value in variables.items():
        lines = [line.replace(f"${name}", value) for line in lines]
    return [shlex.split(line, comments=True) for line in lines]


def command_lines() -> dict[str, list[str]]:
    """Every command line of Ray, MLflow and this package, by where it stands."""
    found = {f"compose {name}": service["command"] for name, service in SERVICES.items() if "command" in service}
    for mapping in mappings(base()):
        if "args" in mapping:
            found[f"base {mapping['name']}"] = mapping["args"]
        if "rayStartParams" in mapping:
            options = [f"--{key}={value}" for key, value in mapping["rayStartParams"].items()]
            found[f"base {mapping.get('groupName', 'head')}"] = ["ray", "start", *options]
    for path in sorted((KUBERNETES / "jobs").rglob("rayjob.yaml")):
        found[f"job {path.parent.name}"] = shlex.split(documents(path)[0]["spec"]["entrypoint"])
    for i, words in enumerate(readme_lines()):
        if words[:2] == ["docker", "compose"] and "run" in words:
            words = words[words.index("mlflow") + 1 :]
        if words and words[0] in ("ray", "mlflow", "python"):
            found[f"README {i} {words[0]}"] = words
    found["image"] = shlex.split(re.findall(r"^CMD (.*)", DOCKERFILE, re.M)[0].translate(str.maketrans("[],", "   ")))
    return {place: [expanded(word) for word in words] for place, words in found.items()}


@functools.cache
def check(file: str, name: str) -> jsonschema.Draft202012Validator:
    """The check for a definition of a file in ``deploy_fields``, in kuberay.yaml's notation; objects are closed."""
    definitions = documents(Path(__file__).parent / "fields" / file)[0]

    def converted(node: Any) -> dict[str, Any]:
        if isinstance(node, dict):
            return {
                "type": "object",
                "properties": {key.removesuffix("!"): converted(value) for key, value in node.items() if key != "*"},
                "required": [key.removesuffix("!") for key in node if key.endswith("!")],
                "additionalProperties": converted(node["*"]) if "*" in node else False,
            }
        if isinstance(node, list):
            return {"type": "array", "items": converted(node[0]), "minItems": 1}
        if node in ("string", "integer", "boolean"):
            return {"type": node}
        if node == "kubernetes":
            return {}
        if node in definitions:
            return {"$ref": f"#/$defs/{node}"}
        return {"enum": node.split("|")}

    schemas = {key: converted(value) for key, value in definitions.items()}
    return jsonschema.Draft202012Validator({"$ref": f"#/$defs/{name}", "$defs": schemas})


def closed_schema(crd: Mapping[str, Any], version: str) -> dict[str, Any]:
    """A CRD's schema of a version, with closed objects: the API server drops what it does not know."""

    def closed(node: Any) -> Any:
        if isinstance(node, list):
            return [closed(child) for child in node]
        if not isinstance(node, dict):
            return node
        within = {key: closed(child) for key, child in node.items()}
        is_open = "additionalProperties" in node or node.get("x-kubernetes-preserve-unknown-fields")
        return (
            within
            if is_open or not isinstance(node.get("properties"), dict)
            else within | {"additionalProperties": False}
        )

    (served,) = [each for each in crd["spec"]["versions"] if each["name"] == version]
    schema = closed(served["schema"]["openAPIV3Schema"])
    schema["properties"]["metadata"] = {"type": "object"}
    return schema
