"""The line that submits a job: ``ray job submit ... -- python -m freemesh_ray train|study ...``."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from freemesh_ray.ray_jobs.plug_in_files import beside

#: Of a checkout: what every job runs in.
RUNTIME_ENV = Path("deploy") / "runtime_env.yaml"
#: Cores of a job's own process, by command: a training learns in it, a study only directs its trials.
CPUS: Mapping[str, int] = {"train": 1, "study": 0}


def runtime_env(path: Path, variables: Mapping[str, str], plug_ins: Sequence[str] = ()) -> dict[str, Any]:
    """The runtime environment in a file, with more variables and modules.

    Args:
        path: YAML, as `RUNTIME_ENV`.
        variables: these win over the file's.
        plug_ins: named in the settings; where the upload of the current folder does not bring their modules, they go
            beside it.

    Raises:
        PluginError: there is no such module.
    """
    declared = yaml.safe_load(path.read_text(encoding="utf-8"))
    modules = [*declared.get("py_modules", []), *beside(plug_ins, Path.cwd(), declared.get("excludes", []))]
    brought = {"py_modules": modules} if modules else {}
    return {**declared, **brought, "env_vars": {**declared.get("env_vars", {}), **variables}}


def submission(
    address: str,
    command: Sequence[str],
    environment: Mapping[str, Any],
    *,
    cpus: int,
    submission_id: str | None = None,
    wait: bool = True,
) -> list[str]:
    """The arguments of ``ray job submit`` for a ``freemesh`` command.

    Args:
        address: of the dashboard.
        command: arguments of ``freemesh``; ``--resume`` is added, so that the same line goes on.
        environment: the runtime environment.
        cpus: cores that the job's own process takes; with none it runs on the head.
        submission_id: the job's name; Ray gives it one where this is None.
        wait: follow the job's logs until it is over.
    """
    resumed = [*command, *(() if "--resume" in command else ("--resume",))]
    return [
        "ray", "job", "submit", "--address", address, "--working-dir", ".",
        "--runtime-env-json", json.dumps(environment), "--entrypoint-num-cpus", str(cpus),
        *(("--submission-id", submission_id) if submission_id else ()), *(() if wait else ("--no-wait",)),
        "--", "python", "-m", "freemesh_ray", *resumed,
    ]  # fmt: skip
