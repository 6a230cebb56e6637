"""Runs that the store holds for RUNNING, and whose processes, this user's on this machine, were killed."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

from envs.printable import without_login
from freemesh_ray.storage.owner import Owner
from freemesh_ray.tracking.events import is_id
from freemesh_ray.tracking.journal import Journal
from freemesh_ray.tracking.journal_folders import found
from freemesh_ray.tracking.mlflow_store import absolute, brief, connect, experiment_id
from freemesh_ray.tracking.uploader import Uploader

log = logging.getLogger(__name__)

#: Runs that one start looks at, and bytes of a journal that it delivers; `sync` delivers the rest.
RUNS, BYTES = 100, 64 << 20


def fail_killed_runs(uri: str, experiment: str, except_for: str, folders: Sequence[Path], until: float) -> None:
    """Mark FAILED what killed processes left RUNNING in the experiment, with all that they recorded.

    The store says which runs are RUNNING; which journals are delivered is told by the folders alone.

    Args:
        uri: of the store, as it is configured.
        experiment: its name.
        except_for: our id of the run at work.
        folders: where runs and studies lie, as it is configured; the journals below them are delivered.
        until: when to stop at the latest, by ``time.monotonic``; the next start goes on.
    """
    client, here = connect(uri), Owner.here()
    query = f"attributes.status = 'RUNNING' and tags.`freemesh.user` = '{here.user}'"
    mine = f"{query} and tags.`freemesh.machine` = '{here.machine}'"
    runs = _found(client, experiment_id(client, uri, experiment), mine)
    left = {run.data.tags["freemesh.id"]: run for run in islice(runs, RUNS) if _is_mine(run, here)}
    left.pop(except_for, None)
    for root in (folder.resolve() for folder in folders if left):
        for path in found(root):
            if time.monotonic() >= until or not left:
                return
            if run := left.pop(path.stem, None):
                with _by_itself(path.stem):
                    _settle(path, root, uri, experiment, run.info.run_id, until)
    for own_id, run in left.items():  # their folders are gone
        owner = _owner(run)
        if owner and owner.is_gone(here, run.info.start_time / 1000) and time.monotonic() < until:
            with _by_itself(own_id):
                client.set_terminated(run.info.run_id, "FAILED")


def _found(client: Any, experiment: str, query: str) -> Iterator[Any]:
    """The runs that a query finds, asked for one by one: each may have as many tags as an answer has room for."""
    token: str | None = ""
    while token is not None:
        page = client.search_runs([experiment], query, max_results=1, page_token=token or None)
        yield from page
        token = page.token or None


def _settle(path: Path, root: Path, uri: str, experiment: str, run_id: str, until: float) -> None:
    """Deliver the journal of a killed run, if it is that run's."""
    journal = Journal.claim(path, root)
    if journal is None:
        return  # at work
    try:
        state = journal.state
        target = (without_login(absolute(uri)), experiment, run_id)
        if (state.uri, state.experiment, state.run_id) == target and journal.size <= BYTES and journal.is_over():
            Uploader(journal, uri, experiment).settle(until)
    finally:
        journal.release()


def _is_mine(run: Any, here: Owner) -> bool:
    """Whether this user recorded a run on this machine, as its tags have it; the store may tell of any."""
    owner = _owner(run)
    mine = owner is not None and owner.same_user(here) and owner.machine == here.machine
    return mine and is_id(run.data.tags.get("freemesh.id"))


def _owner(run: Any) -> Owner | None:
    """The process that recorded a run, as its tags have it."""
    return Owner.parsed({name: run.data.tags.get(f"freemesh.{name}") for name in Owner.here().told()})


@contextmanager
def _by_itself(name: str) -> Iterator[None]:
    """What one run fails by does not keep the others."""
    try:
        yield
    except Exception as error:
        log.info("tracking: %s stays as it is (%s)", name, brief(error))
