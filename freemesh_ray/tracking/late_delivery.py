"""Later delivery: what an absent store did not get, from the journals of many runs."""

from __future__ import annotations

import logging
import shlex
from collections.abc import Sequence
from pathlib import Path

from envs.printable import without_login
from freemesh_ray.storage.owner import Owner
from freemesh_ray.tracking.journal import Journal
from freemesh_ray.tracking.journal_folders import found
from freemesh_ray.tracking.mlflow_store import TrackingError, absolute, failure, mlflow_client
from freemesh_ray.tracking.uploader import ParentMissingError, Uploader

log = logging.getLogger(__name__)

#: Generations of runs: a study's trials are the second.
GENERATIONS = 10


def sync(
    folder: str | Path,
    uri: str,
    *,
    within: Sequence[Path] | None = None,
    also: Sequence[Path] = (),
    elsewhere: bool = True,
) -> int:
    """Deliver what the runs below ``folder`` still hold; a run that died unannounced becomes FAILED.

    Runs still at work, other users' runs, and children of a run that the store does not have and that is not among
    them, are left to themselves, with a warning.

    Args:
        folder: a run's folder, or one above many.
        uri: of the store that gets it.
        within: the folders that journals may lie in; None: ``folder`` and ``also``.
        also: other such folders, as of a study's trials.
        elsewhere: also deliver, and then everything, what was tracked to another store than ``uri``.

    Returns:
        The number of journal entries delivered.

    Raises:
        TrackingError: the store cannot be reached, or ``folder`` lies outside of ``within``, or something in it could
            not be delivered, which is told when all else is.
    """
    mlflow_client()
    delivered = 0
    left: list[LeftError] = []
    orphans: list[tuple[Path, Path, ParentMissingError]] = []
    waiting = _journals(Path(folder), also, within)
    for _ in range(GENERATIONS):  # each round delivers a generation: parents, then their children
        orphans = []
        for path, root in waiting:
            try:
                delivered += _settle(path, root, uri, elsewhere)
            except ParentMissingError as error:
                orphans.append((path, root, error))
            except LeftError as error:
                left.append(error)
        if len(orphans) in (0, len(waiting)):
            break
        waiting = [(path, root) for path, root, _ in orphans]
    for path, _, why in orphans:
        log.warning("tracking: %s is left as it is: %s", path, why)
    for one in left[:-1]:
        log.warning("tracking: %s", one)
    if left:
        raise left[-1]
    return delivered


class LeftError(TrackingError):
    """One journal could not be delivered, or was not to be; one line with its path, the reason and the fix."""


def _journals(folder: Path, also: Sequence[Path], within: Sequence[Path] | None) -> list[tuple[Path, Path]]:
    """The journals below folders, each with the root from which on no link is followed.

    Raises:
        TrackingError: the first of the folders neither lies in one of ``within`` nor above one.
    """
    roots = [root.resolve() for root in ([folder, *also] if within is None else within)]
    journals: dict[Path, Path] = {}
    for place in (folder.resolve(), *(path.resolve() for path in also)):
        inside = [(root, place) for root in roots if place.is_relative_to(root)]
        above = [(root, root) for root in roots if root.is_relative_to(place)]
        if not inside and not above:
            line = f"{place}: lies outside of {' and '.join(map(str, roots))}, where runs are: nothing is sent"
            if place == folder.resolve():
                raise TrackingError(f"{line}; --set paths.runs=FOLDER says where they are")
            log.warning("tracking: %s", line)
        for root, start in inside or above:
            for path in found(start):
                journals.setdefault(path, root)
    return sorted(journals.items())


def _settle(path: Path, root: Path, uri: str, elsewhere: bool) -> int:
    """Deliver one journal.

    Raises:
        TrackingError: the store cannot be reached.
        LeftError: as said there.
        ParentMissingError: its parent must be delivered first.
    """
    journal = Journal.claim(path, root)
    if journal is None:
        log.warning("tracking: %s belongs to a run that is at work, or to another user, or is damaged", path)
        return 0
    try:
        if journal.owner and not journal.owner.same_user(Owner.here()):
            raise LeftError(f"{path}: was recorded by another user, who alone may deliver it")
        if not journal.is_over():
            raise LeftError(f"{path}: belongs to a run on another machine, which may be at work: deliver it there")
        target, there = without_login(absolute(uri)), journal.state.uri
        if target != there and not elsewhere:
            if journal.state.sent >= journal.size:
                return 0
            command = shlex.join(["freemesh", "sync", str(journal.folder), "--uri", ascii(there)[1:-1]])
            raise LeftError(f"{path}: was tracked to another store than {target}: `{command}` delivers it there")
        return _deliver(journal, uri)
    finally:
        journal.release()


def _deliver(journal: Journal, uri: str) -> int:
    uploader = Uploader(journal, uri)
    try:
        return uploader.settle()
    except ParentMissingError:
        raise
    except Exception as error:
        reason = failure(uri, error)
        if uploader.store_answers():
            raise LeftError(f"{journal.path}: is left as it is: {reason}") from error
        raise reason from error
