"""A study that is over, described in its store by what came of its trials, as `MLflowRun.summarise` does at its end."""

from __future__ import annotations

import logging
import shlex
from collections.abc import Sequence
from pathlib import Path

from envs.printable import without_login
from freemesh_ray.tracking.events import LAST, new_event
from freemesh_ray.tracking.journal import Journal, latest
from freemesh_ray.tracking.mlflow_store import absolute, brief, failure, mlflow_client
from freemesh_ray.tracking.study_run import Summary, record
from freemesh_ray.tracking.uploader import Uploader

log = logging.getLogger(__name__)


def summarise(
    folder: str | Path, summary: Summary, *, uri: str, experiment: str, artifacts: Sequence[Path] = (), below: str
) -> str | None:
    """Describe a study's run, and deliver it; nothing is raised on account of tracking.

    A study that is at work is left alone, with a warning: it describes itself at its end. What the store does not get
    now `sync` delivers; so it does where the study was tracked to another store.

    Args:
        folder: of the study.
        summary: what is told.
        uri, experiment: see `MLflowRun`.
        artifacts: files of the study's folder that are uploaded again.
        below: the folder of artifacts that they are uploaded to.

    Returns:
        `MLflowRun.page`; None where the study was never tracked, or the store did not get it.
    """
    journal = None
    try:
        if not any((Path(folder) / "tracking").glob("*.jsonl")):
            return None
        journal = latest(Path(folder))
        if journal is None:
            log.warning("tracking: %s is at work, and is described in the store when it ends", folder)
            return None
        _append(journal, summary, artifacts, below)
        return _delivered(journal, uri, experiment)
    except Exception as error:
        log.warning("tracking: %s is not described in the store (%s)", folder, brief(error))
        return None
    finally:
        if journal is not None:
            journal.release()


def _append(journal: Journal, summary: Summary, artifacts: Sequence[Path], below: str) -> None:
    """Record it, and how the run ended once more: that is what a journal which is over ends with."""
    last = journal.last()
    for path in artifacts:
        journal.append(new_event("artifact", path=str(path.resolve()), folder=below))
    if event := record(journal, summary):
        journal.append(event)
    if last.get("kind") in LAST:
        journal.append(last)


def _delivered(journal: Journal, uri: str, experiment: str) -> str | None:
    """Deliver a journal; its page."""
    mlflow_client()
    state, target = journal.state, (without_login(absolute(uri)), experiment)
    command = shlex.join(["freemesh", "sync", str(journal.folder), "--uri", state.uri])
    if (state.uri, state.experiment) != target:
        log.warning("tracking: %s was tracked to another store: `%s` delivers it there", journal.folder, command)
        return None
    uploader = Uploader(journal, uri, experiment)
    try:
        uploader.deliver()
        uploader.deliver_shared()
    except Exception as error:
        log.warning("tracking: %s; what is missed comes by `%s`", failure(uri, error), command)
        return None
    return journal.state.page
