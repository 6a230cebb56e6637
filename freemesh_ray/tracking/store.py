"""The MLflow store: its client, its address, its limits and what it refuses."""

from __future__ import annotations

import fcntl
import logging
import os
import posixpath
import re
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import which
from typing import Any

from envs.errors import FAILED, UserError
from freemesh_ray.config.paths import shown

log = logging.getLogger(__name__)

#: MLflow's limits for one request, and ours for one parameter's text.
METRICS_PER_BATCH, PARAMS_PER_BATCH, VALUE_LENGTH, KEY_LENGTH = 1000, 100, 500, 250

#: One try and a short wait: deliveries have their own schedule of retries, MLflow's defaults block for minutes. And no
#: reports to its makers, nor addresses printed between the lines of a training run.
ENVIRONMENT = {
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "0",
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "10",
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT": "true",
    "MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR": "false",
}
#: The store understood and refused: sending the same again is of no use.
REFUSED = {"INVALID_PARAMETER_VALUE", "BAD_REQUEST", "INVALID_STATE", "RESOURCE_DOES_NOT_EXIST"}
SQLITE = "sqlite:///"

#: What helps against a failure, by what is in its message.
FIXES = {
    "code 401": "give user and password in MLFLOW_TRACKING_USERNAME and MLFLOW_TRACKING_PASSWORD",
    "code 403": "let the server allow the name that it is called by (--allowed-hosts), and its user to write",
    "deleted": "restore it there (mlflow runs restore), or give another store's uri",
    "refuses": "mend what it names, or give another store's uri",
    "cannot be reached": "start the server, or give another store's uri",
}


class TrackingError(UserError, RuntimeError):
    """The store cannot be reached, or refuses; one line with its address, the reason and the fix."""

    exit_code = FAILED


def failure(uri: str, error: BaseException) -> TrackingError:
    """What an exception of MLflow's, or of the network, means, and what helps."""
    if isinstance(error, TrackingError):
        return error
    refused = getattr(error, "error_code", None) in REFUSED
    what = "refuses" if refused else "cannot be reached"
    fix = next((fix for sign, fix in FIXES.items() if sign in str(error)), None)
    return TrackingError(f"{uri}: {what} ({brief(error)}): {fix or FIXES[what]}")


def mlflow_client() -> Any:
    """MLflow's client class; imported late because that takes seconds."""
    for name, value in ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    for noisy in ("alembic", "mlflow.store.db.utils", "mlflow.pyfunc"):
        logging.getLogger(noisy).setLevel(logging.WARNING)
    from mlflow import MlflowClient

    return MlflowClient


def connect(uri: str) -> Any:
    """A client of the store at ``uri``; a sqlite store is made when there is none."""
    with _one_at_a_time(uri):
        _make_whole(uri)
        address = address_of(uri)
        return mlflow_client()(address, address)


def absolute(uri: str) -> str:
    """The same store whatever the working directory: the path of a sqlite store made absolute."""
    path = uri.removeprefix(SQLITE)
    return uri if path == uri or path.startswith(":") else f"{SQLITE}{Path(path).absolute()}"


def address_of(uri: str) -> str:
    """The store's URI as MLflow reads it: ``%`` and ``?`` in a file's name are escaped.

    MLflow makes the folder that an escaped ``sqlite:///`` URI spells, but none for a URI that names the driver too.
    """
    path = uri.removeprefix(SQLITE)
    if path == uri or not {"%", "?"} & set(path):
        return uri
    return f"sqlite+pysqlite:///{path.replace('%', '%25').replace('?', '%3F')}"


def browsing(uri: str) -> str:
    """What shows the store in a browser: a command to paste into a shell, or the server's own address."""
    if not uri.startswith(SQLITE):
        return uri
    mlflow = "mlflow" if which("mlflow") else shown(Path(sys.executable).with_name("mlflow"))
    return shlex.join([mlflow, "ui", "--backend-store-uri", address_of(shown(uri))])


def experiment_id(client: Any, uri: str, name: str) -> str:
    """The experiment's id, made when there is none; a sqlite store keeps its artifacts in ``mlartifacts`` beside it.

    Raises:
        TrackingError: the experiment is deleted.
    """
    found = client.get_experiment_by_name(name)
    if found and found.lifecycle_stage == "deleted":
        restore = f"mlflow experiments restore --experiment-id {found.experiment_id}"
        raise TrackingError(
            f"{uri}: the experiment {name!r} is deleted: restore it "
            f"(MLFLOW_TRACKING_URI={shlex.quote(address_of(uri))} {restore}), or set another tracking.experiment"
        )
    if found:
        return found.experiment_id
    path = Path(uri.removeprefix(SQLITE))
    place = (path.parent / "mlartifacts").as_uri() if uri.startswith(SQLITE) else None
    # The kind decides which of the UI's two faces opens: charts of training, not chat traces.
    tags = {"mlflow.experimentKind": "custom_model_development"}
    try:
        return client.create_experiment(name, artifact_location=place, tags=tags)
    except Exception as error:
        if getattr(error, "error_code", None) != "RESOURCE_ALREADY_EXISTS":
            raise
        return client.get_experiment_by_name(name).experiment_id  # another process was faster


def run_of(client: Any, experiment: str, own_id: str) -> Any | None:
    """The run that carries our id, in the experiment with the id ``experiment``."""
    found = client.search_runs([experiment], f"tags.`freemesh.id` = '{own_id}'", max_results=1)
    return found[0] if found else None


@contextmanager
def unless_refused(what: str) -> Iterator[None]:
    """Drop what the store will never take, so that it does not hold up the rest; the journal still has it."""
    try:
        yield
    except Exception as error:
        if getattr(error, "error_code", None) not in REFUSED:
            raise
        log.warning("tracking: the store refused %s (%s)", what, brief(error))


def accepted_key(key: str) -> str:
    """A name that MLflow accepts."""
    allowed = re.sub(r"[^\w\-. :/]", "_", key[:KEY_LENGTH], flags=re.ASCII)
    return posixpath.normpath(f"/{allowed}").strip("/") or "_"


def brief(error: BaseException) -> str:
    """The first line of an error, cut to a readable length."""
    text = (str(error) or type(error).__name__).splitlines()[0]
    return text if len(text) <= 160 else text[:157] + "..."


@contextmanager
def _one_at_a_time(uri: str) -> Iterator[None]:
    """Processes that open a new sqlite store together would all make its tables and trip each other."""
    if not uri.startswith(SQLITE):
        yield
        return
    path = Path(uri.removeprefix(SQLITE))
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.with_name(f"{path.name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _make_whole(uri: str) -> None:
    """Make a new sqlite store under another name first: a kill while its tables are made would leave half a store."""
    path = Path(uri.removeprefix(SQLITE))
    if not uri.startswith(SQLITE) or path.exists():
        return
    draft = path.with_name(f".{path.name}.draft")
    draft.unlink(missing_ok=True)
    mlflow_client()(address_of(f"{SQLITE}{draft}")).search_experiments(max_results=1)
    os.replace(draft, path)
