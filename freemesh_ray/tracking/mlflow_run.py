"""A run: what it says goes into its journal at once, and a thread of its own delivers the journal."""

from __future__ import annotations

import logging
import math
import platform
import shlex
import shutil
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

from envs.printable import without_login
from freemesh_ray.storage.atomic import replacing
from freemesh_ray.tracking.events import Event, new_event
from freemesh_ray.tracking.journal import Journal, State, latest
from freemesh_ray.tracking.killed_runs import fail_killed_runs
from freemesh_ray.tracking.mlflow_store import (
    VALUE_LENGTH,
    absolute,
    accepted_key,
    brief,
    failure,
    mlflow_client,
)
from freemesh_ray.tracking.model_registry import commit, fingerprint
from freemesh_ray.tracking.provenance import provenance
from freemesh_ray.tracking.study_run import Summary, record
from freemesh_ray.tracking.uploader import ParentMissingError, Uploader

log = logging.getLogger(__name__)

Status = Literal["FINISHED", "FAILED", "KILLED"]

#: Seconds between two deliveries, and the longest pause while the store is away.
BATCH_SECONDS, RETRY_SECONDS = 1.0, 60.0
#: How long `MLflowRun.close` waits at most for the last delivery; it returns at once when the store is away.
FLUSH_SECONDS = 15.0
#: The same for a run that was interrupted: schedulers kill it after ten.
INTERRUPTED_SECONDS = 3.0
#: How long a start takes at most for the runs that were killed before it.
KILLED_RUNS_SECONDS = 10.0

#: MLflow's comparison of runs opens on the metric that came first: not to be a constant, or a time, of the training
#: loop, those of these names wait for the first evaluation.
HELD = ("train/", "learner/")


class MLflowRun:
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
        resume: bool = False,
        folders: Sequence[str | Path] = (),
        enabled: bool = True,
        flush_seconds: float = FLUSH_SECONDS,
    ) -> None:
        """Begin, or resume, a run; what this user's killed runs on this machine left RUNNING becomes FAILED.

        Args:
            folder: the run's folder; the journal is kept in ``tracking`` below it.
            uri: ``sqlite:///file`` (relative to the working directory) or ``http://host:port``.
            experiment: its name; it is made when there is none.
            name: the run's name.
            params: dotted key -> scalar; one that changed since the run began becomes a tag ``resumed.<key>``.
            tags: beside ``commit`` and the versions of `provenance`.
            parent: `MLflowRun.id` of the run, in the same experiment, that this one belongs to; None: a resumed run
                keeps its own.
            resume: resume the last run of ``folder``, whether or not a store was ever reached, in the one given now.
            folders: where runs and studies lie; what killed runs recorded is delivered from below them alone.
            enabled: False: a run that does nothing.
            flush_seconds: how long `close` waits at most.
        """
        self._flush_seconds = flush_seconds
        self._closing = threading.Event()
        self._ready = threading.Event()
        self._full = False  # the disk is: the journal takes nothing
        self._held: list[Event] | None = []  # the first metrics, until what comes before them; None: it has come
        self._uploader: Uploader | None = None
        self._thread: threading.Thread | None = None
        self._others: threading.Thread | None = None  # cares for the killed runs, and holds up nothing
        if not enabled:
            return
        with _harmless("tracking is off"):
            mlflow_client()  # here, not in the thread: two threads that import the same packages can trip each other
            self._place = absolute(uri), experiment
            self._folders = [Path(path) for path in folders]
            journal = latest(Path(folder)) if resume else None
            if journal:
                journal.own()
            else:
                journal = Journal.new(Path(folder), State(without_login(absolute(uri)), experiment))
            texts = {key: without_login(str(value))[:VALUE_LENGTH] for key, value in (params or {}).items()}
            own = {"freemesh.host": platform.node(), "freemesh.journal": str(journal.path)}
            where = provenance()
            everything = {**(tags or {}), **where, **commit(where), **own}
            journal.append(new_event("start", name=name, params=texts, tags=everything, parent=parent))
            self._uploader = Uploader(journal, uri, experiment)
            if self._uploader.has_metrics:
                self._held = None
            self._thread = threading.Thread(target=self._work, name="tracking", daemon=True)
            self._thread.start()

    @property
    def id(self) -> str | None:
        """Ours, known at once, the tag ``freemesh.id`` in the store; None for a run that does nothing."""
        return self._uploader.journal.id if self._uploader else None

    @property
    def run_id(self) -> str | None:
        """MLflow's id, None until the store was reached; `wait` for it where it is needed."""
        return self._uploader.journal.state.run_id if self._uploader else None

    @property
    def page(self) -> str | None:
        """Where the store shows it, behind the store's address; None until the store was reached.

        Of a study that was summarised its curves, of any other run its own.
        """
        return self._uploader.journal.state.page if self._uploader else None

    def wait(self, seconds: float) -> str | None:
        """MLflow's id, as soon as there is one and at the latest after ``seconds``."""
        if self._uploader:
            self._ready.wait(seconds)
        return self.run_id

    def metrics(self, values: Mapping[str, float], step: int) -> None:
        """Record numbers at ``step`` (env steps), NaN and infinities included; what is no number is left out.

        Of the steps that a run repeats when it is resumed from before its end, the first record counts. A run's first
        metrics are held back while all of them are of `HELD`.
        """
        with _harmless("metrics were not recorded"):
            numbers = {
                accepted_key(key): number for key, value in values.items() if (number := _number(value)) is not None
            }
            event = new_event("metrics", step=int(step), values=numbers)
            if self._held is None or self._uploader is None:
                self._record(event)
            elif not numbers or all(name.startswith(HELD) for name in numbers):
                self._held.append(event)
            else:
                self._record(event)
                self._release()

    def _release(self) -> None:
        """Record what was held back."""
        held, self._held = self._held or [], None
        for event in held:
            self._record(event)

    def summarise(self, summary: Summary) -> None:
        """Describe the study whose run this is by what came of its trials, in place of what was recorded before.

        Recorded again with the same content it changes nothing.
        """
        with _harmless("a summary was not recorded"):
            if self._uploader is None or self._closing.is_set():
                return
            if event := record(self._uploader.journal, summary):
                self._record(event)

    def artifact(self, path: str | Path, folder: str | None = None) -> None:
        """Upload a file of the run's folder below ``folder``; it must stay where it is until it is delivered."""
        with _harmless("an artifact was not recorded"):
            self._record(new_event("artifact", path=str(Path(path).resolve()), folder=folder))

    def model(
        self,
        policy: str | Path,
        *,
        name: str,
        alias: str = "best",
        tags: Mapping[str, str] | None = None,
        description: str = "",
    ) -> None:
        """Register a policy, once the store is there: see `register`. It is copied now, and may change afterwards."""
        with _harmless("a model was not recorded"):
            if self._uploader is None:
                return
            import mlflow.pyfunc  # noqa: F401  here, not in the thread

            journal = self._uploader.journal
            mark = fingerprint(policy, journal.id)
            copy = journal.path.parent / "models" / f"{mark}.npz"
            with replacing(copy) as draft:
                shutil.copyfile(policy, draft)
            everything = {**(tags or {}), **commit(provenance())}
            what = {"name": name, "alias": alias, "tags": everything, "description": description}
            self._record(new_event("model", path=str(copy), mark=mark, **what))

    def close(self, status: Status = "FINISHED") -> None:
        """End the run and deliver what is left; waits for ``flush_seconds`` at most, and less where it was killed.

        What remains is left to `sync`.
        """
        if self._thread is None or self._uploader is None or self._closing.is_set():
            return
        with _harmless("the end of the run was not recorded"):
            self._release()
            self._record(new_event("end", status=status))
        self._closing.set()
        patience = min(self._flush_seconds, INTERRUPTED_SECONDS) if status == "KILLED" else self._flush_seconds
        deadline = time.monotonic() + patience
        self._thread.join(patience)
        if self._thread.is_alive():
            log.warning("tracking: not all is delivered yet; %s delivers the rest", self._sync_line())
        elif self._others:
            self._others.join(max(0.0, deadline - time.monotonic()))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None or (isinstance(error, SystemExit) and not error.code):
            self.close("FINISHED")
        else:
            self.close("KILLED" if issubclass(kind, KeyboardInterrupt) else "FAILED")

    def _record(self, event: Event) -> None:
        if self._uploader is None or self._closing.is_set():
            return
        try:
            self._uploader.journal.append(event)
            self._full = False
        except OSError as error:
            if not self._full:  # once, not at every step
                path = self._uploader.journal.path
                log.warning(
                    "tracking: %s cannot be written to (%s): make room; what comes until then is lost",
                    path, brief(error),
                )  # fmt: skip
            self._full = True

    def _sync_line(self) -> str:
        """The command that delivers what the store missed."""
        assert self._uploader is not None
        journal = self._uploader.journal
        return f"`{shlex.join(['freemesh', 'sync', str(journal.folder), '--uri', journal.state.uri])}`"

    def _work(self) -> None:
        """The thread: deliver, rest, again; once closing, one last time."""
        assert self._uploader is not None
        journal, pause, away, first = self._uploader.journal, BATCH_SECONDS, False, True
        while True:
            closing = self._closing.is_set()
            try:
                self._uploader.deliver()
                self._ready.set()
                self._uploader.deliver_shared()
                if first:
                    self._others = threading.Thread(target=self._fail_killed_runs, name="tracking", daemon=True)
                    self._others.start()
                if away:
                    log.warning("tracking: %s is back", journal.state.uri)
                pause, away, first = BATCH_SECONDS, False, False
            except ParentMissingError as error:
                log.info("tracking: %s waits: %s", journal.id, error)
                pause = min(2 * pause, RETRY_SECONDS)
            except Exception as error:
                if not away:
                    reason = failure(journal.state.uri, error)
                    log.warning("tracking: %s; what is missed comes later, or by %s", reason, self._sync_line())
                pause, away = min(2 * pause, RETRY_SECONDS), True
            if closing:
                break
            self._closing.wait(pause)
        journal.release()

    def _fail_killed_runs(self) -> None:
        """The other thread: what may take its time does not delay what this run records."""
        uri, experiment = self._place
        with _harmless("killed runs were not looked for"):
            fail_killed_runs(uri, experiment, str(self.id), self._folders, time.monotonic() + KILLED_RUNS_SECONDS)


@contextmanager
def _harmless(what: str) -> Iterator[None]:
    """Training goes on whatever happens inside; it is logged."""
    try:
        yield
    except Exception as error:
        log.warning("tracking: %s (%s)", what, brief(error))


def _number(value: Any) -> float | str | None:
    """A number as JSON can hold it (NaN and infinities as text); None for what is no number."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else str(number)
