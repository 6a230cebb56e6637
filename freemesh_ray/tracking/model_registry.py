"""The model registry: a policy as a version of a named MLflow model, to load and serve: see `pyfunc_model`."""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from freemesh_ray.policies.policy import Policy
from freemesh_ray.storage.owner import Owner
from freemesh_ray.tracking.mlflow_store import (
    TrackingError,
    absolute,
    artifacts_of,
    connect,
    experiment_id,
    failure,
    run_of,
)
from freemesh_ray.tracking.provenance import provenance

#: MLflow keeps a copy of this file with the model, and runs it to load the model.
CODE = Path(__file__).with_name("pyfunc_model.py")
#: What meshing needs besides the package, by the versions that are installed.
REQUIREMENTS = ("freemesh-ray", "mlflow", "numpy", "numba", "scipy", "shapely")
#: The example that the store shows: a square with 12 boundary vertices.
SQUARE = [[0, 0], [1, 0], [2, 0], [3, 0], [3, 1], [3, 2], [3, 3], [2, 3], [1, 3], [0, 3], [0, 2], [0, 1], [0, 0]]


def register(
    policy: str | Path,
    *,
    uri: str,
    name: str,
    alias: str = "best",
    run: str | None = None,
    tags: Mapping[str, str] | None = None,
    description: str = "",
) -> str:
    """Register a policy now; the same policy of the same run is registered once. See `MLflowRun.model` for later.

    Args:
        policy: a ``policy.npz``.
        uri: of the store, as for MLflowRun.
        name: of the registered model; it is made when there is none.
        alias: given to the version, and taken from the one that had it: ``models:/NAME@ALIAS``.
        run: the run it comes from, by `MLflowRun.id` or MLflow's id; None: one is made, in the experiment ``name``.
        tags: of the version, beside the git commit.
        description: of the version.

    Returns:
        The version.

    Raises:
        PolicyError: not a policy.
        TrackingError: the store cannot be reached, refuses, or does not have the run.
    """
    place = absolute(uri)
    lone = fingerprint(policy, "")
    try:
        client = connect(place)
        source = _run(client, experiment_id(client, place, name), lone) if run is None else _find(client, run)
        if source is None:
            raise TrackingError(f"{uri}: has no run {run}: deliver it first (freemesh sync), or give another run")
        mark = fingerprint(policy, source.data.tags.get("freemesh.id", source.info.run_id))
        return add_version(
            client, place, Path(policy), source, mark=mark, name=name, alias=alias,
            tags={**(tags or {}), **commit(provenance())}, description=description,
        )  # fmt: skip
    except Exception as error:
        raise failure(uri, error) from error


def add_version(
    client: Any,
    uri: str,
    policy: Path,
    run: Any,
    *,
    mark: str,
    name: str,
    alias: str,
    tags: Mapping[str, str],
    description: str,
) -> str:
    """Log the policy as an MLflow model of ``run``, make it a version of ``name`` and give it the alias.

    May be called again: what an earlier call with the same ``mark`` has done is found by it.

    Returns:
        The version.
    """
    _make_name(client, name)
    marked = list(client.search_model_versions(f"tags.`freemesh.model` = '{mark}'"))
    made = next((version for version in marked if version.name == name), None)
    if made is None:
        model = _logged_model(client, uri, policy, run, mark, name)
        # A sqlite registry would look models:/ID up in whatever store the process has as its default.
        direct = client.tracking_uri.startswith("sqlite")
        made = client.create_model_version(
            name, model.artifact_location if direct else f"models:/{model.model_id}", run_id=run.info.run_id,
            model_id=model.model_id, tags={**tags, "freemesh.model": mark}, description=description,
        )  # fmt: skip
        versions = [{"name": version.name, "version": str(version.version)} for version in [*marked, made]]
        client.set_logged_model_tags(model.model_id, {"mlflow.modelVersions": json.dumps(versions)})
    client.set_registered_model_alias(name, alias, str(made.version))
    return str(made.version)


def save(policy: Path, folder: Path, model: Any) -> None:
    """Write the MLflow model of a policy into ``folder``, which is made.

    Args:
        policy: a ``policy.npz``.
        folder: must not exist.
        model: MLflow's description of it, to be completed.
    """
    from mlflow.models import ModelSignature
    from mlflow.pyfunc import save_model
    from mlflow.types.schema import Array, ColSpec, DataType, Map, Schema

    number, text = DataType.double, DataType.string
    inputs = Schema([
        ColSpec(text, "geojson"), ColSpec(number, "edge_length", required=False),
        ColSpec(number, "grading", required=False),
    ])  # fmt: skip
    outputs = Schema([
        ColSpec(Array(Array(number)), "vertices"), ColSpec(Array(Array(DataType.long)), "quads"),
        ColSpec(Map(number), "quality"),
    ])  # fmt: skip
    save_model(
        str(folder),
        mlflow_model=model,
        python_model=str(CODE),
        artifacts={"policy": str(policy)},
        signature=ModelSignature(inputs, outputs),
        input_example=[{"geojson": json.dumps({"type": "Polygon", "coordinates": [SQUARE]})}],
        pip_requirements=[f"{package}=={metadata.version(package)}" for package in REQUIREMENTS],
    )


def fingerprint(policy: str | Path, run: str) -> str:
    """What tells a policy of a run from others: a hash of both.

    Raises:
        PolicyError: not a policy.
    """
    Policy.load(policy)
    return hashlib.sha256(Path(policy).read_bytes() + run.encode()).hexdigest()[:32]


def commit(where: Mapping[str, str]) -> dict[str, str]:
    """The tag ``commit``, where it is known; the pages do not show MLflow's own tag of it among the others."""
    known = where.get("mlflow.source.git.commit")
    return {"commit": known} if known else {}


def _logged_model(client: Any, uri: str, policy: Path, run: Any, mark: str, name: str) -> Any:
    """The logged model, made and uploaded unless an earlier call did."""
    from mlflow.entities import LoggedModelOutput, LoggedModelStatus
    from mlflow.models import Model

    experiment, run_id = run.info.experiment_id, run.info.run_id
    found = client.search_logged_models([experiment], f"tags.`freemesh.model` = '{mark}'")
    model = found[0] if found else client.create_logged_model(
        experiment, name, source_run_id=run_id, tags={"freemesh.model": mark}, model_type="polygon mesher"
    )  # fmt: skip
    if model.status != LoggedModelStatus.READY:
        with tempfile.TemporaryDirectory() as place:
            about = Model(artifact_path=model.artifact_location, run_id=run_id, model_id=model.model_id)
            save(policy, Path(place) / "model", about)
            artifacts_of(client, uri, model.artifact_location).log_artifacts(str(Path(place) / "model"))
        client.log_outputs(run_id, [LoggedModelOutput(model.model_id, step=0)])
        client.finalize_logged_model(model.model_id, LoggedModelStatus.READY)
    return model


def _make_name(client: Any, name: str) -> None:
    try:
        client.create_registered_model(name)
    except Exception as error:
        if getattr(error, "error_code", None) != "RESOURCE_ALREADY_EXISTS":
            raise


def _run(client: Any, experiment: str, mark: str) -> Any:
    """A run of this user's to hang a model on that comes from none."""
    user = Owner.here().user
    made = run_of(client, experiment, mark, user) or client.create_run(
        experiment, tags={"freemesh.id": mark, "freemesh.user": user}
    )
    client.set_terminated(made.info.run_id)
    return made


def _find(client: Any, run: str) -> Any | None:
    """The run with our or MLflow's id, in whichever experiment."""
    for experiment in client.search_experiments():
        if found := run_of(client, experiment.experiment_id, run):
            return found
    try:
        return client.get_run(run)
    except Exception as error:
        if getattr(error, "error_code", None) in {"RESOURCE_DOES_NOT_EXIST", "INVALID_PARAMETER_VALUE"}:
            return None
        raise
