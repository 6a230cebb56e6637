"""Uploads a journal to its store."""

from __future__ import annotations

import itertools
import logging
import platform
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from freemesh_ray.tracking import registry
from freemesh_ray.tracking.journal import Event, Journal, new_event, now, shared
from freemesh_ray.tracking.store import (
    METRICS_PER_BATCH,
    PARAMS_PER_BATCH,
    accepted_key,
    brief,
    connect,
    experiment_id,
    run_of,
    unless_refused,
)

log = logging.getLogger(__name__)

#: Journal lines read at a time.
LINES = 1000


class ParentMissingError(RuntimeError):
    """The store does not have the parent's run yet; the child waits for it."""


class Uploader:
    """Uploads a journal to its store. Every method raises when the store cannot be reached, and may be called again.

    Its memory is two numbers a metric and a path a shared run, however long the journals.
    """

    def __init__(self, journal: Journal) -> None:
        self.journal = journal
        self._client: Any = None
        self._shared: set[Path] = set()  # those that are delivered
        #: The highest step of each metric, now and when the run was last taken up again.
        self._reached: dict[str, int] = {}
        self._repeated: dict[str, int] = {}
        for event, _ in itertools.takewhile(lambda item: item[1] <= journal.state.sent, journal.read()):
            match event.get("kind"):
                case "start":
                    self._repeated = dict(self._reached)
                case "metrics":
                    self._reach(event)

    def deliver(self) -> int:
        """Send what has not arrived yet, in order.

        Returns:
            The number of journal lines that arrived.

        Raises:
            ParentMissingError: the run belongs to one that the store does not have yet.
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
            self.journal.append({**new_event("end", status="FAILED"), "time": last.get("time", now())})
        return self.deliver()

    def deliver_shared(self) -> None:
        """Send what other runs share with this one, whole journals, each once."""
        for path in shared(self.journal.path.parent).glob("*.jsonl"):
            if path in self._shared or not (journal := Journal.claim(path)):
                continue
            try:
                Uploader(journal).settle()
            except ParentMissingError:
                pass  # it was shared with an earlier run of this folder
            finally:
                journal.release()
            self._shared.add(path)

    def fail_killed_runs(self) -> None:
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
                    Uploader(journal).settle()
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
            case "model":
                self._model(events[0])
            case "end":
                event = events[0]
                with unless_refused("the end of the run"):
                    self._store().set_terminated(self.journal.state.run_id, event["status"], end_time=event["time"])

    def _start(self, event: Event) -> None:
        """Make the run, or find the one that an interrupted delivery made, or take it up again."""
        client, state = self._store(), self.journal.state
        above = self._parent(event.get("parent"))
        if state.run_id is None:
            run = run_of(client, self._experiment(), self.journal.id) or client.create_run(
                self._experiment(), event["time"], {"freemesh.id": self.journal.id}, event["name"]
            )
            state.run_id = run.info.run_id
            self.journal.save()
        elif state.sent == 0:  # a run from elsewhere: only the store knows what it has
            run = client.get_run(state.run_id)
            for key in run.data.metrics:
                self._reached[key] = max(metric.step for metric in client.get_metric_history(state.run_id, key))
        self._repeated = dict(self._reached)
        client.update_run(state.run_id, "RUNNING")
        self._describe(event["params"], event["tags"] | above)

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
        labels = [RunTag(accepted_key(key), value) for key, value in (tags | changed).items()]
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
            self._reached[key] = max(event["step"], self._reached.get(key, event["step"]))

    def _artifact(self, event: Event) -> None:
        client, run_id, path = self._store(), self.journal.state.run_id, Path(event["path"])
        upload = client.log_artifacts if path.is_dir() else client.log_artifact
        try:
            upload(run_id, str(path), event["folder"])
        except Exception as error:
            client.get_run(run_id)  # raises when the store as a whole is away: the artifact then waits with the rest
            log.warning("tracking: %s was not uploaded (%s)", path, brief(error))

    def _model(self, event: Event) -> None:
        client, policy = self._store(), Path(event["path"])
        if not policy.is_file():
            log.warning("tracking: %s was not registered (it is gone)", policy)
            return
        what = {key: event[key] for key in ("mark", "name", "alias", "tags", "description")}
        with unless_refused("a model"):
            registry.add_version(client, policy, client.get_run(self.journal.state.run_id), **what)

    def _store(self) -> Any:
        """The client, connected at first use."""
        if self._client is None:
            self._client = connect(self.journal.state.uri)
        return self._client

    def _experiment(self) -> str:
        return experiment_id(self._store(), self.journal.state.uri, self.journal.state.experiment)


def _chunks(items: list[Any], size: int) -> Iterator[list[Any]]:
    return (items[start : start + size] for start in range(0, len(items), size))
