"""Uploads a journal to the store that this process is configured for."""

from __future__ import annotations

import itertools
import logging
import math
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from envs.printable import without_login
from freemesh_ray.config.document import MOST_BYTES
from freemesh_ray.policies.policy import PolicyError
from freemesh_ray.storage import own_file
from freemesh_ray.storage.owner import Owner
from freemesh_ray.tracking import charts, model_registry
from freemesh_ray.tracking.events import LAST, Event, new_event, now
from freemesh_ray.tracking.journal import ARTIFACT_BYTES, Journal, State, shared
from freemesh_ray.tracking.mlflow_store import (
    METRICS_PER_BATCH,
    PARAMS_PER_BATCH,
    absolute,
    accepted_key,
    artifacts_of,
    brief,
    connect,
    experiment_id,
    is_recorded_by,
    run_of,
    unless_refused,
)
from freemesh_ray.tracking.provenance import COMMIT
from freemesh_ray.tracking.study_run import COLOUR, IS_COLOUR

log = logging.getLogger(__name__)

#: Journal lines read at a time, metrics whose steps are remembered, and bytes of a model.
LINES, METRICS, MODEL_BYTES = 1000, 20_000, 50_000_000
#: Characters of a run's description, MLflow's limit of a tag; and where a study's report is among its artifacts.
NOTE, REPORT = 8000, "report/report.html"


class ParentMissingError(RuntimeError):
    """The store does not have the parent's run yet; the child waits for it."""


class Uploader:
    """Uploads a journal to its store. Every method raises when the store cannot be reached, and may be called again.

    Its memory is two numbers a metric and a path a shared run, however long the journals. It changes runs of the store
    that carry the journal's id and were recorded by this user, and no others.
    """

    def __init__(self, journal: Journal, uri: str, experiment: str | None = None) -> None:
        """Read what is delivered already.

        Args:
            journal: what is delivered; another store than it went to before gets all of it.
            uri: of the store, as it is configured.
            experiment: its name; None: as the journal says.
        """
        self.journal, self.uri = journal, absolute(uri)
        state = journal.state
        target = without_login(self.uri), experiment or state.experiment
        if (state.uri, state.experiment) != target:
            journal.state = State(*target, owner=state.owner)
        self._user = Owner.here().user
        self._client: Any = None
        self._seen = False  # whether the run in the store was looked at
        self._shared: dict[Path, int] = {}  # those that are delivered, and how long they were
        #: The highest step of each metric, now and when the run was last taken up again.
        self._reached: dict[str, int] = {}
        self._repeated: dict[str, int] = {}
        for event, _ in itertools.takewhile(lambda item: item[1] <= journal.state.sent, journal.read()):
            match event.get("kind"):
                case "start":
                    self._repeated = dict(self._reached)
                case "metrics":
                    self._reach(event)

    @property
    def has_metrics(self) -> bool:
        """Whether some are delivered."""
        return bool(self._reached)

    def deliver(self, until: float = math.inf) -> int:
        """Send what has not arrived yet, in order.

        Args:
            until: when to stop at the latest, by ``time.monotonic``.

        Returns:
            The number of journal lines that arrived.

        Raises:
            ParentMissingError: the run belongs to one that the store does not have yet.
        """
        count = 0
        while lines := list(itertools.islice(self.journal.read(self.journal.state.sent), LINES)):
            if not self._seen:
                self._seen = True
                if not self._is_ours():
                    self._begin_anew()
                    continue
            # Neighbouring metrics travel together, and so does what is no event; everything else alone.
            for _, group in itertools.groupby(lines, _company):
                if time.monotonic() >= until:
                    return count
                events, ends = zip(*group, strict=True)
                self._send(events)
                self.journal.state.sent = ends[-1]
                self.journal.save()
                count += len(events)
        return count

    def settle(self, until: float = math.inf) -> int:
        """Deliver all of a journal whose process is gone; without an end of its own the run is FAILED."""
        last = self.journal.last()
        if last.get("kind") not in LAST:
            self.journal.append({**new_event("end", status="FAILED"), "time": last.get("time", now())})
        return self.deliver(until)

    def deliver_shared(self) -> None:
        """Send what other runs share with this one, whole journals, each once, and again when it is longer."""
        for path in shared(self.journal.path.parent).glob("*.jsonl"):
            size = _size(path)
            if self._shared.get(path) == size or not (journal := Journal.claim(path, self.journal.folder)):
                continue
            try:
                Uploader(journal, self.uri, self.journal.state.experiment).settle()
            except ParentMissingError:
                pass  # it was shared with an earlier run of this folder
            except Exception as error:
                if not self.store_answers():
                    raise
                log.warning("tracking: %s is left as it is (%s)", path, brief(error))
            finally:
                journal.release()
            self._shared[path] = size

    def store_answers(self) -> bool:
        """Whether the store as a whole is there, so that what failed is the journal's."""
        try:
            self._store().search_experiments(max_results=1)
        except Exception:
            return False
        return True

    def _is_ours(self) -> bool:
        """Whether the run that the state names is the journal's, and of this user: a state says what it likes."""
        state = self.journal.state
        if state.run_id is None:
            return state.sent == 0
        try:
            run = self._store().get_run(state.run_id)
        except Exception as error:
            if getattr(error, "error_code", None) in {"RESOURCE_DOES_NOT_EXIST", "INVALID_PARAMETER_VALUE"}:
                return False
            raise
        return is_recorded_by(run, self.journal.id, self._user)

    def _begin_anew(self) -> None:
        """Deliver everything, to a run of its own."""
        state = self.journal.state
        self.journal.state = State(state.uri, state.experiment, owner=state.owner)
        self._reached, self._repeated = {}, {}

    def _send(self, events: tuple[Event, ...]) -> None:
        kind = events[0].get("kind")
        if kind != "start" and self.journal.state.run_id is None:
            return  # of a journal whose beginning is lost
        match kind:
            case "metrics":
                self._metrics(events)
            case "start":
                self._start(events[0])
            case "artifact":
                self._artifact(events[0])
            case "model":
                self._model(events[0])
            case "summary":
                self._summary(events[0])
            case "end":
                event = events[0]
                with unless_refused("the end of the run"):
                    self._store().set_terminated(self.journal.state.run_id, event["status"], end_time=event["time"])
            case "delete":
                with unless_refused("the deletion of the run"):
                    self._store().delete_run(self.journal.state.run_id)

    def _start(self, event: Event) -> None:
        """Make the run, or find the one that an interrupted delivery made, or take it up again."""
        client, state = self._store(), self.journal.state
        above = self._parent(event["parent"])
        if state.run_id is None:
            own = {"freemesh.id": self.journal.id, "freemesh.user": self._user}
            run = run_of(client, self._experiment(), self.journal.id, self._user) or client.create_run(
                self._experiment(), event["time"], own, event["name"]
            )
            state.run_id = run.info.run_id
            self.journal.save()
        self._repeated = dict(self._reached)
        client.update_run(state.run_id, "RUNNING")
        told = {key: value for key, value in event["tags"].items() if _may_be_told(key, value)}
        params = {key: without_login(value) for key, value in event["params"].items()}  # earlier versions kept them
        self._describe(params, told | self._own_tags() | above)
        if state.page is None:
            state.page = charts.run_page(self._experiment(), str(state.run_id))

    def _own_tags(self) -> dict[str, str]:
        """The tags by which a run is known as this user's, and its process as gone."""
        owner = self.journal.owner
        process = {f"freemesh.{name}": value for name, value in owner.told().items()} if owner else {}
        return process | {"freemesh.id": self.journal.id, "freemesh.user": self._user}

    def _parent(self, own_id: str | None) -> dict[str, str]:
        """The tag that hangs the run below its parent."""
        if own_id is None:
            return {}
        parent = run_of(self._store(), self._experiment(), own_id)
        if parent is None:
            raise ParentMissingError(f"its parent {own_id} is not there yet")
        return {"mlflow.parentRunId": parent.info.run_id}

    def _describe(self, params: dict[str, str], tags: dict[str, str]) -> None:
        from mlflow.entities import Param, RunTag

        client, run_id = self._store(), self.journal.state.run_id
        old = client.get_run(run_id).data.params
        changed = {f"resumed.{key}": value for key, value in params.items() if old.get(key, value) != value}
        fresh = [Param(accepted_key(key), value) for key, value in params.items() if key not in old]
        labels = [RunTag(accepted_key(key), value) for key, value in (changed | tags).items()]
        with unless_refused("tags and parameters"):
            for chunk in _chunks(labels, PARAMS_PER_BATCH):
                client.log_batch(run_id, tags=chunk, synchronous=True)
            for chunk in _chunks(fresh, PARAMS_PER_BATCH):
                client.log_batch(run_id, params=chunk, synchronous=True)

    def _metrics(self, events: tuple[Event, ...]) -> None:
        """Send numbers, but not the stretch that a resumed run repeats: what it recorded first counts."""
        from mlflow.entities import Metric

        fresh = [
            Metric(key, float(value), event["time"], event["step"])
            for event in events
            for key, value in event["values"].items()
            if key not in self._repeated or event["step"] > self._repeated[key]
        ]
        for chunk in _chunks(fresh, METRICS_PER_BATCH):
            with unless_refused("metrics"):
                self._store().log_batch(self.journal.state.run_id, metrics=chunk, synchronous=True)
        for event in events:
            self._reach(event)

    def _reach(self, event: Event) -> None:
        for key in event["values"]:
            if key in self._reached or len(self._reached) < METRICS:
                self._reached[key] = max(event["step"], self._reached.get(key, event["step"]))

    def _summary(self, event: Event) -> None:
        """Describe a study: the run's description with links, its figures, and the view that its page opens."""
        from mlflow.entities import Metric

        client, run_id = self._store(), self.journal.state.run_id
        experiment = self._experiment()
        page = charts.study_page(experiment, str(run_id))
        report = charts.run_page(experiment, str(run_id), f"artifacts/{REPORT}")
        links = f"[Curves of all variants]({page}) · [Report]({report})"
        fresh = [Metric(name, float(value), event["time"], event["step"]) for name, value in event["values"].items()]
        with unless_refused("a summary"):
            client.set_tag(run_id, "mlflow.note.content", f"{links}\n\n{fitted(event['text'], NOTE - len(links) - 2)}")
            for chunk in _chunks(fresh, METRICS_PER_BATCH):
                client.log_batch(run_id, metrics=chunk, synchronous=True)
            client.set_experiment_tag(
                experiment, f"{charts.VIEW}{charts.key(str(run_id))}", charts.view(str(run_id), event["charts"])
            )
            self.journal.state.page = page

    def _artifact(self, event: Event) -> None:
        client, run_id, path = self._store(), self.journal.state.run_id, Path(event["path"])
        with tempfile.TemporaryDirectory() as place:
            copy = Path(place) / path.name
            try:  # what was checked is sent, whatever becomes of the file meanwhile
                own_file.copy(self.journal.folder, path, copy, ARTIFACT_BYTES)
                _strip(copy)
            except (OSError, ValueError) as error:
                log.warning("tracking: %s was not uploaded (%s)", ascii(str(path))[1:-1], brief(error))
                return
            info = client.get_run(run_id).info
            try:
                artifacts_of(client, self.uri, info.artifact_uri).log_artifact(str(copy), event["folder"])
            except Exception as error:
                client.get_run(run_id)  # raises when the store as a whole is away: then the artifact waits, too
                log.warning("tracking: %s was not uploaded (%s)", path, brief(error))

    def _model(self, event: Event) -> None:
        client, path = self._store(), Path(event["path"])
        what = {key: event[key] for key in ("mark", "name", "alias", "tags", "description")}
        with tempfile.TemporaryDirectory() as place:
            policy = Path(place) / "policy.npz"
            try:
                own_file.copy(self.journal.folder, path, policy, MODEL_BYTES)
                if model_registry.fingerprint(policy, self.journal.id) != event["mark"]:
                    raise own_file.ForeignFileError("it is another")
            except (OSError, ValueError, PolicyError) as error:
                log.warning("tracking: %s was not registered (%s)", ascii(str(path))[1:-1], brief(error))
                return
            with unless_refused("a model"):
                run = client.get_run(self.journal.state.run_id)
                model_registry.add_version(client, self.uri, policy, run, **what)

    def _store(self) -> Any:
        """The client, connected at first use."""
        if self._client is None:
            self._client = connect(self.uri)
        return self._client

    def _experiment(self) -> str:
        return experiment_id(self._store(), self.uri, self.journal.state.experiment)


def fitted(text: str, room: int) -> str:
    """As many whole lines of a text as go into ``room`` characters, or as much of the first."""
    if len(text) <= room:
        return text
    more = "\n\n(The report has the rest.)"
    left = room - len(more)
    end = text.rfind("\n", 0, left + 1)
    return text[: end if end > 0 else left] + more


def _may_be_told(key: str, value: str) -> bool:
    """Whether a journal's tag goes to the store: of those that mean something to MLflow, two."""
    return key == COMMIT or not key.startswith("mlflow.") or (key == COLOUR and IS_COLOUR.fullmatch(value) is not None)


def _strip(draft: Path) -> None:
    """Take passwords out of a copy of settings: earlier versions wrote them down."""
    if draft.suffix == ".yaml" and draft.stat().st_size <= MOST_BYTES:
        text = draft.read_bytes().decode(errors="surrogateescape")
        draft.write_bytes(without_login(text).encode(errors="surrogateescape"))


def _size(path: Path) -> int:
    """In bytes; 0 where it is gone."""
    try:
        return path.lstat().st_size
    except OSError:
        return 0


def _company(line: tuple[Event, int]) -> str | int:
    """What neighbouring lines of a journal share that are sent together."""
    kind = line[0].get("kind", "none")
    return kind if kind in ("metrics", "none") else line[1]


def _chunks(items: list[Any], size: int) -> Iterator[list[Any]]:
    return (items[start : start + size] for start in range(0, len(items), size))
