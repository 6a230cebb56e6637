"""A run: what it says goes into its journal at once, and a thread of its own delivers the journal."""

from __future__ import annotations

import logging
import math
import platform
import shutil
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

from freemesh_ray.storage.atomic import replacing
from freemesh_ray.tracking.journal import Event, Journal, State, latest, said
from freemesh_ray.tracking.provenance import provenance
from freemesh_ray.tracking.registry import commit, fingerprint
from freemesh_ray.tracking.store import VALUE_LENGTH, absolute, accepted_key, brief, mlflow_client
from freemesh_ray.tracking.uploader import Courier, ParentAwayError

log = logging.getLogger(__name__)

Status = Literal["FINISHED", "FAILED", "KILLED"]

#: Seconds between two deliveries, and the longest pause while the store is away.
BATCH_SECONDS, RETRY_SECONDS = 1.0, 60.0
#: How long `Run.close` waits at most for the last delivery; it returns at once when the store is away.
FLUSH_SECONDS = 15.0


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
            tags: beside ``commit`` and the versions of `provenance`.
            parent: `Run.id` of the run, in the same experiment, that this one belongs to; None: a run taken up again
                keeps its own.
            run_id: MLflow id of the run to take up again.
            resume: take up again the last run of ``folder``, whether or not its store was ever reached.
            enabled: False: a run that does nothing.
            flush_seconds: how long `close` waits at most.
        """
        self._flush_seconds = flush_seconds
        self._closing = threading.Event()
        self._ready = threading.Event()
        self._mute = False  # the journal takes nothing, as on a full disk
        self._courier: Courier | None = None
        self._thread: threading.Thread | None = None
        if not enabled:
            return
        with _harmless("tracking is off"):
            mlflow_client()  # here, not in the thread: two threads that import the same packages can trip each other
            journal = (latest(Path(folder), run_id) if run_id or resume else None) or Journal.new(
                Path(folder), State(absolute(uri), experiment, run_id)
            )
            texts = {key: str(value)[:VALUE_LENGTH] for key, value in (params or {}).items()}
            own = {"freemesh.id": journal.id, "freemesh.host": platform.node(), "freemesh.journal": str(journal.path)}
            where = provenance()
            everything = {**(tags or {}), **where, **commit(where), **own}
            journal.append(said("start", name=name, params=texts, tags=everything, parent=parent))
            self._courier = Courier(journal)
            self._thread = threading.Thread(target=self._work, name="tracking", daemon=True)
            self._thread.start()

    @property
    def id(self) -> str | None:
        """Ours, known at once, the tag ``freemesh.id`` in the store; None for a run that does nothing."""
        return self._courier.journal.id if self._courier else None

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

        Of the steps that a run repeats when it is taken up again from before its end, the first record counts.
        """
        with _harmless("metrics were not recorded"):
            numbers = {
                accepted_key(key): number for key, value in values.items() if (number := _number(value)) is not None
            }
            self._say(said("metrics", step=int(step), values=numbers))

    def artifact(self, path: str | Path, folder: str | None = None) -> None:
        """Upload a file, or a directory's content, below ``folder``; it must stay where it is until it is delivered."""
        with _harmless("an artifact was not recorded"):
            self._say(said("artifact", path=str(Path(path).resolve()), folder=folder))

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
            if self._courier is None:
                return
            import mlflow.pyfunc  # noqa: F401  here, not in the thread

            journal = self._courier.journal
            mark = fingerprint(policy, journal.id)
            copy = journal.path.parent / "models" / f"{mark}.npz"
            with replacing(copy) as draft:
                shutil.copyfile(policy, draft)
            everything = {**(tags or {}), **commit(provenance())}
            what = {"name": name, "alias": alias, "tags": everything, "description": description}
            self._say(said("model", path=str(copy), mark=mark, **what))

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
        if self._courier is None or self._closing.is_set():
            return
        try:
            self._courier.journal.append(event)
            self._mute = False
        except OSError as error:
            if not self._mute:  # once, not at every step
                path = self._courier.journal.path
                log.warning("tracking: %s cannot be written to (%s); what comes is lost", path, brief(error))
            self._mute = True

    def _work(self) -> None:
        """The thread: deliver, rest, again; once closing, one last time."""
        assert self._courier is not None
        journal, pause, away, first = self._courier.journal, BATCH_SECONDS, False, True
        while True:
            closing = self._closing.is_set()
            try:
                self._courier.deliver()
                self._ready.set()
                self._courier.deliver_shared()
                if first:
                    self._courier.bury_the_dead()
                if away:
                    log.warning("tracking: %s is back", journal.state.uri)
                pause, away, first = BATCH_SECONDS, False, False
            except ParentAwayError as reason:
                log.info("tracking: %s waits: %s", journal.id, reason)
                pause = min(2 * pause, RETRY_SECONDS)
            except Exception as error:
                if not away:
                    message = "tracking: %s is away (%s); what it misses is kept in %s"
                    log.warning(message, journal.state.uri, brief(error), journal.path)
                pause, away = min(2 * pause, RETRY_SECONDS), True
            if closing:
                break
            self._closing.wait(pause)
        journal.release()


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
