"""Later delivery: what an absent store did not get, from the journals of many runs."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path

from freemesh_ray.tracking.journal import Journal, State
from freemesh_ray.tracking.store import TrackingError, absolute, failure, mlflow_client
from freemesh_ray.tracking.uploader import ParentMissingError, Uploader

log = logging.getLogger(__name__)


def sync(folder: str | Path, uri: str | None = None, also: Sequence[Path] = ()) -> int:
    """Deliver what the runs below ``folder`` still hold; a run that died unannounced becomes FAILED.

    Args:
        folder: a run's folder, or one above many.
        also: other such folders, as of a study's trials.
        uri: another store than the runs' own; it gets everything.

    Returns:
        The number of journal entries delivered. Runs still at work, and children of a run that the store does not have
        and that is not among them, are left to themselves.

    Raises:
        TrackingError: the store cannot be reached, or nothing was tracked below the folder.
    """
    mlflow_client()
    delivered = 0
    waiting = sorted({path for root in (Path(folder), *also) for path in root.rglob("tracking/**/*.jsonl")})
    if not waiting:
        raise TrackingError(f"{folder}: nothing was tracked here: give a run's folder, or one above many")
    while waiting:  # each round delivers a generation: parents, then their children
        orphans = []
        for path in waiting:
            try:
                delivered += _settle(path, uri)
            except ParentMissingError as error:
                orphans.append((path, str(error)))
        if len(orphans) == len(waiting):
            for path, why in orphans:
                log.warning("tracking: %s is left as it is: %s", path, why)
            break
        waiting = [path for path, _ in orphans]
    return delivered


def _settle(path: Path, uri: str | None) -> int:
    journal = Journal.claim(path)
    if journal is None:
        log.warning("tracking: %s belongs to a run that is at work, or is damaged: sync again when it is over", path)
        return 0
    try:
        if uri is not None and absolute(uri) != journal.state.uri:
            journal.state = State(absolute(uri), journal.state.experiment)
        return Uploader(journal).settle()
    except ParentMissingError:
        raise
    except Exception as error:
        raise failure(journal.state.uri, error) from error
    finally:
        journal.release()
