"""What is installed where this runs, as a CycloneDX bill of materials: ``python deploy/bom.py > bom.json``.

In an image: ``docker run --rm --volume "$PWD/deploy/bom.py:/bom.py:ro" IMAGE python /bom.py > bom.json``. It needs
Python's standard library alone, and says the same each time.
"""

from __future__ import annotations

import json
import re
import sys
from importlib.metadata import Distribution, distributions
from typing import Any
from urllib.parse import quote

PROJECT = "freemesh-ray"


def name_of(distribution: Distribution) -> str:
    """A package's name as indexes normalise it."""
    return re.sub(r"[-_.]+", "-", distribution.metadata["Name"]).lower()


def reference(distribution: Distribution) -> str:
    """A package's URL (purl), which also names it within the bill."""
    return f"pkg:pypi/{name_of(distribution)}@{quote(distribution.version)}"


def licences(distribution: Distribution) -> list[dict[str, Any]]:
    """What a package says of its licence: an SPDX expression, or else the names of its classifiers."""
    if expression := distribution.metadata.get("License-Expression"):
        return [{"expression": expression}]
    told = [line.rpartition(" :: ")[2] for line in distribution.metadata.get_all("Classifier", [])
            if line.startswith("License :: ") and line != "License :: OSI Approved"]  # fmt: skip
    return [{"license": {"name": name}} for name in told]


def component(distribution: Distribution) -> dict[str, Any]:
    """A package as CycloneDX has it."""
    described: dict[str, Any] = {
        "type": "library",
        "bom-ref": reference(distribution),
        "name": name_of(distribution),
        "version": distribution.version,
        "purl": reference(distribution),
    }
    if licenses := licences(distribution):
        described["licenses"] = licenses
    return described


def needs(distribution: Distribution, there: dict[str, Distribution]) -> list[str]:
    """References of those installed packages that a package names among its requirements."""
    names = {re.sub(r"[-_.]+", "-", re.match(r"[\w.-]+", line)[0]).lower() for line in distribution.requires or []}  # type: ignore[index]
    return sorted(reference(there[name]) for name in names & there.keys() - {name_of(distribution)})


def bill() -> dict[str, Any]:
    """All that is installed, of each package the one that is imported."""
    there: dict[str, Distribution] = {}
    for distribution in distributions():
        there.setdefault(name_of(distribution), distribution)
    own = there.get(PROJECT)
    about = {**component(own), "type": "application"} if own else {"type": "application", "name": PROJECT}
    others = [there[name] for name in sorted(there) if name != PROJECT]
    return {
        "$schema": "http://cyclonedx.org/schema/bom-1.6.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": about},
        "components": [component(one) for one in others],
        "dependencies": [
            {"ref": reference(one), "dependsOn": needs(one, there)} for one in ([own] if own else []) + others
        ],
    }


if __name__ == "__main__":
    json.dump(bill(), sys.stdout, indent=1)
    sys.stdout.write("\n")
