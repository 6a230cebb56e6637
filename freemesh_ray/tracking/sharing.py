"""A run that one study trained and another needs as well: recorded again, as a child of the other study's run."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

from envs.printable import without_login
from freemesh_ray.storage import own_file
from freemesh_ray.storage.atomic import replacing
from freemesh_ray.storage.owner import Owner
from freemesh_ray.tracking.events import Event
from freemesh_ray.tracking.journal import ARTIFACT_BYTES, State, entries, journals, shared
from freemesh_ray.tracking.mlflow_store import absolute, brief

log = logging.getLogger(__name__)


def share(
    folder: str | Path,
    *,
    into: str | Path,
    uri: str,
    experiment: str,
    name: str,
    parent: str,
    tags: Mapping[str, str] | None = None,
) -> str | None:
    """Record a finished run once more, as a child of another parent: its parameters, metrics and artifacts.

    Recorded twice, for the same run and parent, it is one run; what is a child of this parent stays as it is. The copy
    of its journal is delivered by the parent while that is at work, and else by `sync`; this neither waits nor raises.

    Args:
        folder: the finished run's folder.
        into: the other parent's folder; the copy is kept in ``tracking/shared`` below it.
        uri, experiment, name: see MLflowRun.
        parent: `MLflowRun.id` of the other parent.
        tags: these replace the run's own; ``freemesh.shared_from`` is the id of the run as it was first recorded.

    Returns:
        The id of the child, as `MLflowRun.id`; None when the run was never tracked or the copy cannot be written.
    """
    try:
        original = journals(Path(folder).resolve())[-1]
    except IndexError:
        log.warning("tracking: %s was not tracked, so it is not shared", folder)
        return None
    root = Path(folder).resolve()
    if _parent(original, root) == parent:
        return original.stem
    place = shared(Path(into).resolve() / "tracking") / f"{original.stem}-{parent}.jsonl"
    if place.exists():
        return place.stem
    own = {"freemesh.journal": str(place), "freemesh.shared_from": original.stem}
    state = State(without_login(absolute(uri)), experiment, owner=Owner.here().told())
    try:
        with replacing(place.with_suffix(".json")) as draft:
            draft.write_text(json.dumps(asdict(state)), encoding="utf-8")
        with replacing(place) as draft, draft.open("w", encoding="utf-8") as file:
            for event in _copied(original, root, place.with_suffix(""), name, parent, {**(tags or {}), **own}):
                file.write(json.dumps(event) + "\n")
    except Exception as error:
        log.warning("tracking: %s is not shared (%s)", folder, brief(error))
        return None
    return place.stem


def _events(journal: Path, root: Path) -> Iterator[Event]:
    """The events of a journal below ``root``; none where it cannot be read."""
    try:
        descriptor = own_file.opened(root, journal)
    except OSError:
        return
    try:
        yield from (event for event, _ in entries(descriptor))
    finally:
        os.close(descriptor)


def _parent(journal: Path, root: Path) -> str | None:
    """The parent that the run was last started with."""
    parent = None
    for event in _events(journal, root):
        if event.get("kind") == "start":
            parent = event["parent"] or parent
    return parent


def _copied(original: Path, root: Path, files: Path, name: str, parent: str, tags: dict[str, str]) -> Iterator[Event]:
    """The journal's events under another name, parent and tags, with copies of its artifacts below ``files``."""
    for number, event in enumerate(_events(original, root)):
        match event.get("kind"):
            case "start":
                yield event | {"name": name, "parent": parent, "tags": event["tags"] | tags}
            case "artifact":
                path = Path(event["path"])
                copy = files / str(number) / path.name
                with suppress(OSError, ValueError):  # one that is gone, or was never the run's
                    copy.parent.mkdir(parents=True, exist_ok=True)
                    copy.unlink(missing_ok=True)
                    own_file.copy(root, path, copy, ARTIFACT_BYTES)
                    yield event | {"path": str(copy)}
            case "metrics" | "end":  # a model is registered by one run
                yield event
