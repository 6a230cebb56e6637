"""MLflow tracking that training never waits for and never fails by; the only file that imports MLflow.

What a run has to say is first appended, as JSON lines, to a journal in the run's folder; a thread of its own delivers
the journal to the store in batches:

    metrics(...) --> <run folder>/tracking/<id>.jsonl --> thread: log_batch --> MLflow store
                     <run folder>/tracking/<id>.json  (how far, which MLflow run)

So the queue between training and the store is a file: it takes no memory, it outlives a killed process, and what an
absent store did not get is delivered by the run's resumption or by `sync`. Delivery can be repeated: an entry keeps its
time stamp, and MLflow stores equal entries once. The journal is locked while its run lives; the kernel frees the lock
of a process that was killed, which is how a later start tells a dead run (and marks it FAILED) from one still at work.
"""

from __future__ import annotations

import fcntl
import itertools
import logging
import math
import os
import platform
import posixpath
import re
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

from freemesh_ray.journal import Event, Journal, State, latest, now, said
from freemesh_ray.provenance import provenance

log = logging.getLogger(__name__)

Status = Literal["FINISHED", "FAILED", "KILLED"]

#: Seconds between two deliveries, and the longest pause while the store is away.
BATCH_SECONDS, RETRY_SECONDS = 1.0, 60.0
#: How long `Run.close` waits at most for the last delivery; it returns at once when the store is away.
FLUSH_SECONDS = 15.0
#: MLflow's limits for one request, and ours for one parameter's text.
METRICS_PER_BATCH, PARAMS_PER_BATCH, VALUE_LENGTH, KEY_LENGTH = 1000, 100, 500, 250
#: Journal lines read at a time.
LINES = 1000

#: One try and a short wait: the thread has its own schedule of retries, MLflow's defaults block for minutes. And no
#: reports to its makers, nor addresses printed between the lines of a training run.
ENVIRONMENT = {
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "0",
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "10",
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT": "true",
}
#: The store understood and refused: sending the same again is of no use.
REFUSED = {"INVALID_PARAMETER_VALUE", "BAD_REQUEST", "INVALID_STATE", "RESOURCE_DOES_NOT_EXIST"}
SQLITE = "sqlite:///"


class TrackingError(RuntimeError):
    """The store cannot be reached; one line with its address, the reason and the fix."""


# ---- what a run says -------------------------------------------------------------------------------------------------


class Run:
    """One MLflow run as a context manager: FINISHED, FAILED by an exception, KILLED by ctrl-C.

    No method raises on account of tracking, and none but `close` waits.
    """

    def __init__(
        self,
        folder: str | Path,
        *,
        uri: str,
        experiment: str,
        name: str,
        params: Mapping[str, Any] | None = None,
        tags: Mapping[str, str] | None = None,
        parent: str | None = None,
        run_id: str | None = None,
        resume: bool = False,
        enabled: bool = True,
        flush_seconds: float = FLUSH_SECONDS,
    ) -> None:
        """Begin, or take up again, a run; what an earlier killed run on this machine left RUNNING becomes FAILED.

        Args:
            folder: the run's folder; the journal is kept in ``tracking`` below it.
            uri: ``sqlite:///file`` (relative to the working directory) or ``http://host:port``.
            experiment: its name; it is made when there is none.
            name: the run's name.
            params: dotted key -> scalar; one that changed since the run began becomes a tag ``resumed.<key>``.
            tags: beside the git commit and the versions of `provenance`.
            parent: MLflow id of the run that this one belongs to.
            run_id: MLflow id of the run to take up again.
            resume: take up again the last run of ``folder``, whether or not its store was ever reached.
            enabled: False: a run that does nothing.
            flush_seconds: how long `close` waits at most.
        """
        self._flush_seconds = flush_seconds
        self._closing = threading.Event()
        self._ready = threading.Event()
        self._courier: _Courier | None = None
        self._thread: threading.Thread | None = None
        if not enabled:
            return
        with _harmless("tracking is off"):
            _mlflow()  # here, not in the thread: two threads that import the same packages can trip each other
            journal = (latest(Path(folder), run_id) if run_id or resume else None) or Journal.new(
                Path(folder), State(absolute(uri), experiment, run_id)
            )
            texts = {key: str(value)[:VALUE_LENGTH] for key, value in (params or {}).items()}
            own = {"freemesh.id": journal.id, "freemesh.host": platform.node(), "freemesh.journal": str(journal.path)}
            above = {"mlflow.parentRunId": parent} if parent else {}
            everything = {**(tags or {}), **provenance(), **above, **own}
            journal.append(said("start", name=name, params=texts, tags=everything))
            self._courier = _Courier(journal)
            self._thread = threading.Thread(target=self._work, name="tracking", daemon=True)
            self._thread.start()

    @property
    def run_id(self) -> str | None:
        """MLflow's id, None until the store was reached; `wait` for it where it is needed."""
        return self._courier.journal.state.run_id if self._courier else None

    def wait(self, seconds: float) -> str | None:
        """MLflow's id, as soon as there is one and at the latest after ``seconds``."""
        if self._courier:
            self._ready.wait(seconds)
        return self.run_id

    def metrics(self, values: Mapping[str, float], step: int) -> None:
        """Record numbers at ``step`` (env steps), NaN and infinities included; what is no number is left out.

        Of a key and step given twice, as by a run that resumes from before its end, the first counts.
        """
        with _harmless("metrics were not recorded"):
            numbers = {_key(key): number for key, value in values.items() if (number := _number(value)) is not None}
            self._say(said("metrics", step=int(step), values=numbers))

    def artifact(self, path: str | Path, folder: str | None = None) -> None:
        """Upload a file, or a directory's content, below ``folder``; it must stay where it is until it is delivered."""
        with _harmless("an artifact was not recorded"):
            self._say(said("artifact", path=str(Path(path).resolve()), folder=folder))

    def close(self, status: Status = "FINISHED") -> None:
        """End the run and deliver what is left; waits for ``flush_seconds`` at most. What remains is left to `sync`."""
        if self._thread is None or self._courier is None or self._closing.is_set():
            return
        with _harmless("the end of the run was not recorded"):
            self._say(said("end", status=status))
        self._closing.set()
        self._thread.join(self._flush_seconds)
        if self._thread.is_alive():
            log.warning("tracking: not all is delivered yet; the rest is kept in %s", self._courier.journal.path)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None or (isinstance(error, SystemExit) and not error.code):
            self.close("FINISHED")
        else:
            self.close("KILLED" if issubclass(kind, KeyboardInterrupt) else "FAILED")

    def _say(self, event: Event) -> None:
        if self._courier and not self._closing.is_set():
            self._courier.journal.append(event)

    def _work(self) -> None:
        """The thread: deliver, rest, again; once closing, one last time."""
        assert self._courier is not None
        journal, pause, away, first = self._courier.journal, BATCH_SECONDS, False, True
        while True:
            closing = self._closing.is_set()
            try:
                self._courier.deliver()
                self._ready.set()
                if first:
                    self._courier.bury_the_dead()
                if away:
                    log.warning("tracking: %s is back", journal.state.uri)
                pause, away, first = BATCH_SECONDS, False, False
            except Exception as error:
                if not away:
                    message = "tracking: %s is away (%s); what it misses is kept in %s"
                    log.warning(message, journal.state.uri, _brief(error), journal.path)
                pause, away = min(2 * pause, RETRY_SECONDS), True
            if closing:
                break
            self._closing.wait(pause)
        journal.release()


def sync(folder: str | Path, uri: str | None = None) -> int:
    """Deliver what the runs below ``folder`` still hold; a run that died unannounced becomes FAILED.

    Args:
        folder: a run's folder, or one above many.
        uri: another store than the runs' own; it gets everything.

    Returns:
        The number of journal entries delivered. Runs still at work are left to themselves.

    Raises:
        TrackingError: the store cannot be reached.
    """
    _mlflow()
    delivered = 0
    for path in sorted(Path(folder).rglob("tracking/*.jsonl")):
        journal = Journal.claim(path)
        if journal is None:
            log.warning("tracking: %s belongs to a run that is at work; left as it is", path)
            continue
        try:
            if uri is not None and absolute(uri) != journal.state.uri:
                journal.state = State(absolute(uri), journal.state.experiment)
            delivered += _Courier(journal).settle()
        except Exception as error:
            fix = "start the server, or give another store's uri"
            raise TrackingError(f"{journal.state.uri}: cannot be reached ({_brief(error)}): {fix}") from error
        finally:
            journal.release()
    return delivered


def absolute(uri: str) -> str:
    """The same store whatever the working directory: the path of a sqlite store made absolute."""
    path = uri.removeprefix(SQLITE)
    return uri if path == uri or path.startswith(":") else f"{SQLITE}{Path(path).absolute()}"


# ---- delivery --------------------------------------------------------------------------------------------------------


class _Courier:
    """Carries a journal to its store. Every method raises when the store cannot be reached, and may be called again."""

    def __init__(self, journal: Journal) -> None:
        self.journal = journal
        self._client: Any = None
        arrived = itertools.takewhile(lambda item: item[1] <= journal.state.sent, journal.read())
        self._seen = {
            (key, event["step"])
            for event, _ in arrived
            if event.get("kind") == "metrics"
            for key in event["values"]
        }  # fmt: skip

    def deliver(self) -> int:
        """Send what has not arrived yet, in order.

        Returns:
            The number of journal lines that arrived.
        """
        count = 0
        while lines := list(itertools.islice(self.journal.read(self.journal.state.sent), LINES)):
            # Neighbouring metrics travel together, everything else alone.
            for _, group in itertools.groupby(lines, lambda line: line[0].get("kind") == "metrics" or line[1]):
                events, ends = zip(*group, strict=True)
                self._send(events)
                self.journal.state.sent = ends[-1]
                self.journal.save()
                count += len(events)
        return count

    def settle(self) -> int:
        """Deliver all of a journal whose process is gone; without an end of its own the run is FAILED."""
        last: Event = {}
        for event, _ in self.journal.read():
            last = event
        if last.get("kind") != "end":
            self.journal.append({**said("end", status="FAILED"), "time": last.get("time", now())})
        return self.deliver()

    def bury_the_dead(self) -> None:
        """Mark FAILED what this machine's killed processes left RUNNING in the experiment."""
        client, state = self._store(), self.journal.state
        query = f"attributes.status = 'RUNNING' and tags.`freemesh.host` = '{platform.node()}'"
        for run in client.search_runs([self._experiment()], query):
            path = Path(run.data.tags.get("freemesh.journal", ""))
            if run.info.run_id == state.run_id:
                continue
            if not path.exists():
                client.set_terminated(run.info.run_id, "FAILED")
            elif journal := Journal.claim(path):
                try:
                    _Courier(journal).settle()
                finally:
                    journal.release()

    def _send(self, events: tuple[Event, ...]) -> None:
        match events[0].get("kind"):
            case "metrics":
                self._metrics(events)
            case "start":
                self._start(events[0])
            case "artifact":
                self._artifact(events[0])
            case "end":
                event = events[0]
                with _unless_refused("the end of the run"):
                    self._store().set_terminated(self.journal.state.run_id, event["status"], end_time=event["time"])

    def _start(self, event: Event) -> None:
        """Make the run, or find the one that an interrupted delivery made, or take it up again."""
        client, state = self._store(), self.journal.state
        if state.run_id is None:
            made = client.search_runs([self._experiment()], f"tags.`freemesh.id` = '{self.journal.id}'")
            run = made[0] if made else client.create_run(
                self._experiment(), event["time"], {"freemesh.id": self.journal.id}, event["name"]
            )  # fmt: skip
            state.run_id = run.info.run_id
            self.journal.save()
        elif state.sent == 0:  # a run from elsewhere: only the store knows what it has
            run = client.get_run(state.run_id)
            self._seen = {(key, metric.step) for key in run.data.metrics
                          for metric in client.get_metric_history(state.run_id, key)}  # fmt: skip
        client.update_run(state.run_id, "RUNNING")
        self._describe(event["params"], event["tags"])

    def _describe(self, params: dict[str, str], tags: dict[str, str]) -> None:
        from mlflow.entities import Param, RunTag

        client, run_id = self._store(), self.journal.state.run_id
        old = client.get_run(run_id).data.params
        changed = {f"resumed.{key}": value for key, value in params.items() if old.get(key, value) != value}
        fresh = [Param(_key(key), value) for key, value in params.items() if key not in old]
        with _unless_refused("tags and parameters"):
            for chunk in _chunks(
                [RunTag(_key(key), value) for key, value in (tags | changed).items()], PARAMS_PER_BATCH
            ):
                client.log_batch(run_id, tags=chunk, synchronous=True)
            for chunk in _chunks(fresh, PARAMS_PER_BATCH):
                client.log_batch(run_id, params=chunk, synchronous=True)

    def _metrics(self, events: tuple[Event, ...]) -> None:
        from mlflow.entities import Metric

        fresh: dict[tuple[str, int], Any] = {}
        for event in events:
            for key, value in event["values"].items():
                place = (key, event["step"])
                if place not in self._seen:
                    fresh.setdefault(place, Metric(key, float(value), event["time"], event["step"]))
        for chunk in _chunks(list(fresh.items()), METRICS_PER_BATCH):
            with _unless_refused("metrics"):
                batch = [metric for _, metric in chunk]
                self._store().log_batch(self.journal.state.run_id, metrics=batch, synchronous=True)
            self._seen |= {place for place, _ in chunk}

    def _artifact(self, event: Event) -> None:
        client, run_id, path = self._store(), self.journal.state.run_id, Path(event["path"])
        upload = client.log_artifacts if path.is_dir() else client.log_artifact
        try:
            upload(run_id, str(path), event["folder"])
        except Exception as error:
            client.get_run(run_id)  # raises when the store as a whole is away: the artifact then waits with the rest
            log.warning("tracking: %s was not uploaded (%s)", path, _brief(error))

    def _store(self) -> Any:
        """The client, connected at first use."""
        if self._client is None:
            uri = self.journal.state.uri
            with _one_at_a_time(uri):
                _make_whole(uri)
                self._client = _mlflow()(uri)
        return self._client

    def _experiment(self) -> str:
        """The experiment's id; a sqlite store keeps its artifacts in ``mlartifacts`` beside the database."""
        client, state = self._store(), self.journal.state
        found = client.get_experiment_by_name(state.experiment)
        if found:
            return found.experiment_id
        path = Path(state.uri.removeprefix(SQLITE))
        place = (path.parent / "mlartifacts").as_uri() if state.uri.startswith(SQLITE) else None
        # The kind decides which of the UI's two faces opens: charts of training, not chat traces.
        tags = {"mlflow.experimentKind": "custom_model_development"}
        return client.create_experiment(state.experiment, artifact_location=place, tags=tags)


# ---- small parts -----------------------------------------------------------------------------------------------------


def _mlflow() -> Any:
    """MLflow's client class; imported late because that takes seconds."""
    for name, value in ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    for noisy in ("alembic", "mlflow.store.db.utils"):
        logging.getLogger(noisy).setLevel(logging.WARNING)
    from mlflow import MlflowClient

    return MlflowClient


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
    _mlflow()(f"{SQLITE}{draft}").search_experiments(max_results=1)
    os.replace(draft, path)


@contextmanager
def _harmless(what: str) -> Iterator[None]:
    """Training goes on whatever happens inside; it is logged."""
    try:
        yield
    except Exception as error:
        log.warning("tracking: %s (%s)", what, _brief(error))


@contextmanager
def _unless_refused(what: str) -> Iterator[None]:
    """Drop what the store will never take, so that it does not hold up the rest; the journal still has it."""
    try:
        yield
    except Exception as error:
        if getattr(error, "error_code", None) not in REFUSED:
            raise
        log.warning("tracking: the store refused %s (%s)", what, _brief(error))


def _key(key: str) -> str:
    """A name that MLflow accepts."""
    allowed = re.sub(r"[^\w\-. :/]", "_", key[:KEY_LENGTH], flags=re.ASCII)
    return posixpath.normpath(f"/{allowed}").strip("/") or "_"


def _number(value: Any) -> float | str | None:
    """A number as JSON can hold it (NaN and infinities as text); None for what is no number."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else str(number)


def _chunks(items: list[Any], size: int) -> Iterator[list[Any]]:
    return (items[start : start + size] for start in range(0, len(items), size))


def _brief(error: BaseException) -> str:
    """The first line of an error, cut to a readable length."""
    text = (str(error) or type(error).__name__).splitlines()[0]
    return text if len(text) <= 160 else text[:157] + "..."
