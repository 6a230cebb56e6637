"""The MLflow store: its client, its address, its limits and what it refuses."""

from __future__ import annotations

import fcntl
import logging
import os
import posixpath
import re
import shlex
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import which
from typing import Any
from urllib.parse import unquote, urlsplit

from envs.errors import FAILED, UserError
from envs.printable import without_login
from freemesh_ray.config.paths import shown
from freemesh_ray.config.store_login import with_login
from freemesh_ray.storage.atomic import private_folder
from freemesh_ray.tracking.bounded import Bounded
from freemesh_ray.tracking.events import is_id

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
#: Whatever else the environment says: what is sent goes to the configured address alone, and neither to one that the
#: server redirects to nor to one that it names for the parts of a large file.
ONE_ADDRESS = {"MLFLOW_ALLOW_HTTP_REDIRECTS": "false", "MLFLOW_ENABLE_PROXY_MULTIPART_UPLOAD": "false"}
#: Folders beside a sqlite store in which MLflow keeps artifacts.
ARTIFACTS = ("mlartifacts", "mlruns")
#: The store understood and refused: sending the same again is of no use.
REFUSED = {"INVALID_PARAMETER_VALUE", "BAD_REQUEST", "INVALID_STATE", "RESOURCE_DOES_NOT_EXIST"}
SQLITE = "sqlite:///"
#: How long another process is waited for that opens the same store, and may be making its tables.
OPENING_SECONDS = 120.0
#: Where `mlflow ui` serves a file.
SERVED = "http://127.0.0.1:5000"

#: What helps against a failure, by what is in its message.
FIXES = {
    "code 30": "give the address that the server redirects to, if you trust it: redirects are not followed",
    "code 401": "give user and password in MLFLOW_TRACKING_USERNAME and MLFLOW_TRACKING_PASSWORD",
    "code 403": "let the server allow the name that it is called by (--allowed-hosts), and its user to write",
    "answers with more than": "have whoever filled it with so much take that out, or give another store's uri",
    "deleted": "restore it there (mlflow runs restore), or give another store's uri",
    "refuses": "mend what it names, or give another store's uri",
    "cannot be reached": "start the server, or give another store's uri",
}


class TrackingError(UserError, RuntimeError):
    """The store cannot be reached, or refuses; one line with its address, the reason and the fix."""

    exit_code = FAILED


class ElsewhereError(TrackingError):
    """The store wants files sent to another address than its own; one line with both and the fix."""


def failure(uri: str, error: BaseException) -> TrackingError:
    """What an exception of MLflow's, or of the network, means, and what helps."""
    if isinstance(error, TrackingError):
        return error
    refused = getattr(error, "error_code", None) in REFUSED
    what = "refuses" if refused else "cannot be reached"
    fix = next((fix for sign, fix in FIXES.items() if sign in str(error)), None)
    return TrackingError(f"{without_login(uri)}: {what} ({brief(error)}): {fix or FIXES[what]}")


def mlflow_client() -> Any:
    """MLflow's client class; imported late because that takes seconds."""
    for name, value in ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    os.environ.update(ONE_ADDRESS)
    for noisy in ("alembic", "mlflow.store.db.utils", "mlflow.pyfunc"):
        logging.getLogger(noisy).setLevel(logging.WARNING)
    from mlflow import MlflowClient

    return MlflowClient


def connect(uri: str) -> Any:
    """A client of the store at ``uri``, with the login that this process knows for it; a sqlite store is made when
    there is none.
    """
    with _one_at_a_time(uri):
        _make_whole(uri)
        address = with_login(address_of(uri))
        return Bounded(mlflow_client()(address, address))


def absolute(uri: str) -> str:
    """The same store whatever the working directory: the path of a sqlite store made absolute."""
    path = uri.removeprefix(SQLITE)
    return uri if path == uri or path.startswith(":") else f"{SQLITE}{Path(path).absolute()}"


def takes_artifacts(uri: str, place: str) -> bool:
    """Whether the place that a store gives for artifacts is its own: the server itself, or a folder beside its file.

    Args:
        uri: of the store, as it is configured.
        place: address of artifacts, as the store tells it.
    """
    target = urlsplit(place)
    if "\0" in unquote(place):
        return False
    if not uri.startswith(SQLITE):
        # Whoever sends or serves a path may decode it, even twice, and go up in it.
        spelt = unquote(place)
        if {".", ".."} & set(spelt.split("/")) or re.search(r"[?#\\%]", spelt):
            return False
        here = urlsplit(uri)
        address = here.netloc.rpartition("@")[2]
        if target.scheme == "mlflow-artifacts":
            return target.netloc in ("", address)
        served = f"{here.path.rstrip('/')}/api/2.0/mlflow-artifacts/artifacts/"
        return (target.scheme, target.netloc) == (here.scheme, address) and target.path.startswith(served)
    if target.scheme not in ("", "file") or target.netloc:
        return False
    home = Path(uri.removeprefix(SQLITE)).parent
    folders = [(home / folder).resolve() for folder in ARTIFACTS]
    # MLflow may decode a path that has no scheme, too.
    paths = [Path(spelt).resolve() for spelt in ([unquote(target.path)] if target.scheme else [place, unquote(place)])]
    return all(any(path.is_relative_to(folder) for folder in folders) for path in paths)


def artifacts_of(client: Any, uri: str, place: str) -> Any:
    """MLflow's access to the artifacts at ``place``.

    Raises:
        ElsewhereError: they would leave for another address than the store's.
    """
    from mlflow.store.artifact.artifact_repository_registry import get_artifact_repository

    if not takes_artifacts(uri, place):
        moved = uri.startswith(SQLITE)
        fix = "where it was moved" if moved else "let the server take them itself (--serve-artifacts) and"
        raise ElsewhereError(
            f"{without_login(uri)}: wants files sent to {place[:80]!a}, which is another place: "
            f"{fix} set another tracking.experiment"
        )
    return get_artifact_repository(place, tracking_uri=client.tracking_uri)


def address_of(uri: str) -> str:
    """The store's URI as MLflow reads it: ``%`` and ``?`` in a file's name are escaped.

    MLflow makes the folder that an escaped ``sqlite:///`` URI spells, but none for a URI that names the driver too.
    """
    path = uri.removeprefix(SQLITE)
    if path == uri or not {"%", "?"} & set(path):
        return uri
    return f"sqlite+pysqlite:///{path.replace('%', '%25').replace('?', '%3F')}"


def browsing(uri: str, page: str | None = None) -> list[str]:
    """What shows the store in a browser: a command to paste into a shell, or the server's own address.

    Args:
        uri: of the store.
        page: of a run, behind the address, as `MLflowRun.page` has it; None: none is known.

    Returns:
        The address of the page; of a file that no server serves the command, and the address that is then the page's.
    """
    if not uri.startswith(SQLITE):
        return [f"{without_login(uri).rstrip('/')}/{page}" if page else without_login(uri)]
    mlflow = "mlflow" if which("mlflow") else shown(Path(sys.executable).with_name("mlflow"))
    command = shlex.join([mlflow, "ui", "--backend-store-uri", address_of(shown(uri))])
    return [command, *([f"{SERVED}/{page}"] if page else [])]


def experiment_id(client: Any, uri: str, name: str) -> str:
    """The experiment's id, made when there is none; a sqlite store keeps its artifacts in ``mlartifacts`` beside it.

    Raises:
        TrackingError: the experiment is deleted.
    """
    found = client.get_experiment_by_name(name)
    if found and found.lifecycle_stage == "deleted":
        restore = f"mlflow experiments restore --experiment-id {found.experiment_id}"
        bare = without_login(uri)
        raise TrackingError(
            f"{bare}: the experiment {name!r} is deleted: restore it "
            f"(MLFLOW_TRACKING_URI={shlex.quote(address_of(bare))} {restore}), or set another tracking.experiment"
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


def run_of(client: Any, experiment: str, own_id: str, user: str | None = None) -> Any | None:
    """The run that carries our id, in the experiment with the id ``experiment``.

    Args:
        client: of the store.
        experiment: the experiment's id.
        own_id: ours.
        user: who must have recorded it, as the tag ``freemesh.user`` tells; None: it is only looked at.
    """
    if not is_id(own_id):
        return None
    query = f"tags.`freemesh.id` = '{own_id}'" + (f" and tags.`freemesh.user` = '{user}'" if user else "")
    found = client.search_runs([experiment], query, max_results=1)
    return next((run for run in found if is_recorded_by(run, own_id, user)), None)


def is_recorded_by(run: Any, own_id: str, user: str | None) -> bool:
    """Whether a run carries our id, and is of the user when one is given."""
    tags = run.data.tags
    return tags.get("freemesh.id") == own_id and user in (None, tags.get("freemesh.user"))


@contextmanager
def unless_refused(what: str) -> Iterator[None]:
    """Drop what the store will never take, so that it does not hold up the rest; the journal still has it."""
    try:
        yield
    except Exception as error:
        if getattr(error, "error_code", None) not in REFUSED and not isinstance(error, ElsewhereError):
            raise
        log.warning("tracking: the store refused %s (%s)", what, brief(error))


def accepted_key(key: str) -> str:
    """A name that MLflow accepts."""
    allowed = re.sub(r"[^\w\-. :/]", "_", key[:KEY_LENGTH], flags=re.ASCII)
    return posixpath.normpath(f"/{allowed}").strip("/") or "_"


def brief(error: BaseException) -> str:
    """The first line of an error, cut to a readable length."""
    text = without_login((str(error) or type(error).__name__).splitlines()[0])
    return text if len(text) <= 160 else text[:157] + "..."


@contextmanager
def _one_at_a_time(uri: str) -> Iterator[None]:
    """Processes that open a new sqlite store together would all make its tables and trip each other."""
    if not uri.startswith(SQLITE):
        yield
        return
    path = Path(uri.removeprefix(SQLITE))
    path.parent.mkdir(parents=True, exist_ok=True)
    lock = path.with_name(f"{path.name}.lock")
    flags = os.O_RDONLY | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        descriptor = os.open(lock, flags, 0o666)
    except OSError as error:
        raise TrackingError(f"{lock}: is no file of its own ({error.strerror}): remove it") from error
    try:
        deadline = time.monotonic() + OPENING_SECONDS
        while not _locked(descriptor):
            if time.monotonic() >= deadline:
                raise TrackingError(f"{lock}: another process holds it: end that, or give another store's uri")
            time.sleep(0.05)
        yield
    finally:
        os.close(descriptor)


def _locked(descriptor: int) -> bool:
    """Whether the lock could be had, or there are none in this file system."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _make_whole(uri: str) -> None:
    """Make a new sqlite store elsewhere first: a kill while its tables are made would leave half a store."""
    path = Path(uri.removeprefix(SQLITE))
    if not uri.startswith(SQLITE) or path.exists():
        return
    with private_folder(path.parent) as folder:
        draft = folder.resolve() / path.name  # MLflow keeps open what it has opened, by its path
        mlflow_client()(address_of(f"{SQLITE}{draft}")).search_experiments(max_results=1)
        os.replace(draft, path)
