"""A run that is done in one study and wanted in another as well: told again, as a child of the other study's run."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path

from freemesh_ray.atomic import replacing
from freemesh_ray.tracking.courier import Courier
from freemesh_ray.tracking.journal import Event, Journal, State, journals
from freemesh_ray.tracking.store import absolute, brief, mlflow_client

log = logging.getLogger(__name__)


def share(
    folder: str | Path,
    *,
    uri: str,
    experiment: str,
    name: str,
    parent: str,
    tags: Mapping[str, str] | None = None,
    into: str | Path | None = None,
) -> str | None:
    """Make a finished run known as a child of another parent too: its parameters, metrics and artifacts, once more.

    Told twice, for the same run and parent, it is one run. It waits for the store, but does not fail when that is away:
    what is not delivered is left to `sync`.

    Args:
        folder: the finished run's folder.
        uri, experiment, name: see Run.
        parent: `Run.id` of the other parent.
        tags: these replace the run's own; ``freemesh.shared_from`` is the id of the run as it was first told.
        into: folder below whose ``tracking/shared`` the copy of the journal is kept, as the other study's; ``folder``
            by default.

    Returns:
        The id of the child, as `Run.id`; None when the run was never tracked or the copy cannot be written.
    """
    try:
        original = journals(Path(folder))[-1]
    except IndexError:
        log.warning("tracking: %s was not tracked, so it is not shared", folder)
        return None
    place = Path(into or folder).resolve() / "tracking" / "shared" / f"{original.stem}-{parent}.jsonl"
    try:
        mlflow_client()
        if not place.exists():
            own = {"freemesh.id": place.stem, "freemesh.journal": str(place), "freemesh.shared_from": original.stem}
            state = State(absolute(uri), experiment)
            with replacing(place.with_suffix(".json")) as draft:
                draft.write_text(json.dumps(asdict(state)), encoding="utf-8")
            with replacing(place) as draft, draft.open("w", encoding="utf-8") as file:
                for event in _retold(original, name, parent, {**(tags or {}), **own}):
                    file.write(json.dumps(event) + "\n")
    except Exception as error:
        log.warning("tracking: %s is not shared (%s)", folder, brief(error))
        return None
    if journal := Journal.claim(place):
        try:
            Courier(journal).settle()
        except Exception as error:
            log.warning("tracking: %s is away (%s); what it misses is kept in %s", uri, brief(error), place)
        finally:
            journal.release()
    return place.stem


def _retold(original: Path, name: str, parent: str, tags: dict[str, str]) -> Iterator[Event]:
    """The journal's events under another name, parent and tags."""
    for event, _ in Journal.entries(original):
        if event.get("kind") == "start":
            yield event | {"name": name, "parent": parent, "tags": event["tags"] | tags}
        elif event.get("kind") != "model":  # a model is registered by one run
            yield event
