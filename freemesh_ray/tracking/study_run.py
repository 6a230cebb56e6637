"""What a study's run tells of all its trials: a description, figures, and a run below it for each variant.

A variant's run is a journal beside those that other runs share with the study, delivered with them. Its name is a
digest of what it holds: recorded again it is the same run, and one that was recorded before and holds something else is
deleted in the store, by an event of its own journal.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import logging
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from freemesh_ray.storage.atomic import replacing
from freemesh_ray.storage.owner import Owner
from freemesh_ray.tracking.events import Event, new_event, now
from freemesh_ray.tracking.journal import Journal, State, shared
from freemesh_ray.tracking.mlflow_store import accepted_key

log = logging.getLogger(__name__)

#: Tag of the colour that MLflow draws a run in, and what it may be.
COLOUR, IS_COLOUR = "mlflow.runColor", re.compile(r"#[0-9a-f]{6}")
#: Tag of a variant's run: our id of the study's run that it sums up.
SUMS_UP = "freemesh.sums_up"
#: Seconds that a journal is waited for which is being delivered.
PATIENCE_SECONDS = 5.0


@dataclass(frozen=True)
class VariantSummary:
    """A variant, as a run of its own.

    Attributes:
        colour: that its curves are drawn in, ``#rrggbb``.
        params: dotted key -> value: what it sets, beside ``variant``.
        step: env steps that its figures are of.
        values: metric -> figure.
        curves: metric -> (env steps, value), one a point.
    """

    colour: str
    params: Mapping[str, str]
    step: int
    values: Mapping[str, float]
    curves: Mapping[str, Sequence[tuple[int, float]]]


@dataclass(frozen=True)
class Summary:
    """What a study's run tells.

    Attributes:
        text: its description, Markdown.
        step: env steps that its figures are of.
        values: metric -> figure, of the study's run.
        variants: label -> a run below it.
        charts: what its page draws, see `charts.view`.
        tags: of the variants' runs, beside ``variant``.
    """

    text: str
    step: int
    values: Mapping[str, float]
    variants: Mapping[str, VariantSummary]
    charts: Mapping[str, Sequence[str]]
    tags: Mapping[str, str] = field(default_factory=dict)


def record(journal: Journal, summary: Summary) -> Event | None:
    """Record the variants' runs of a study whose journal this process holds.

    Returns:
        The event that the study's own journal is to get; None where it says the same already.

    Raises:
        OSError: a journal cannot be written.
    """
    folder, prefix = shared(journal.path.parent), f"{journal.id}-summary-"
    before = {path for path in sorted(folder.glob(f"{prefix}*.jsonl")) if not _is_deleted(path, journal.folder)}
    for label, variant in summary.variants.items():
        events = _events(label, variant, summary, journal.id)
        digest = _digest(events)
        if same := next((path for path in before if path.stem.split("-")[-2] == digest), None):
            before.remove(same)
        else:
            _write(_unused(folder, f"{prefix}{digest}"), events, journal.state)
    for path in sorted(before):
        _delete(path, journal.folder)
    numbers = {accepted_key(name): float(value) for name, value in summary.values.items()}
    charts = {kind: [accepted_key(name) for name in names] for kind, names in summary.charts.items()}
    event = new_event("summary", step=summary.step, text=summary.text, values=numbers, charts=charts)
    said = [known for known, _ in journal.read() if known.get("kind") == "summary"][-1:]
    return event if _digest(said) != _digest([event]) else None


def _events(label: str, variant: VariantSummary, summary: Summary, parent: str) -> list[Event]:
    """All that a variant's run records."""
    tags = {**summary.tags, "variant": label, SUMS_UP: parent, COLOUR: variant.colour}
    by_step: dict[int, dict[str, float]] = {}
    for name, points in variant.curves.items():
        for step, value in points:
            by_step.setdefault(step, {})[accepted_key(name)] = value
    by_step.setdefault(variant.step, {}).update({accepted_key(name): it for name, it in variant.values.items()})
    time, params = now(), {"variant": label, **{key: str(value) for key, value in variant.params.items()}}
    return [
        {"kind": "start", "time": time, "name": label, "params": params, "tags": tags, "parent": parent},
        *({"kind": "metrics", "time": time, "step": step, "values": by_step[step]} for step in sorted(by_step)),
        {"kind": "end", "time": time, "status": "FINISHED"},
    ]


def _digest(events: Sequence[Event]) -> str:
    """Of everything but the time."""
    content = [{key: value for key, value in event.items() if key != "time"} for event in events]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


def _write(path: Path, events: Sequence[Event], state: State) -> None:
    """Write a journal that is over; its state comes first, so that none is ever without."""
    path.parent.mkdir(parents=True, exist_ok=True)
    new: dict[str, Any] = asdict(State(state.uri, state.experiment, owner=Owner.here().told()))
    with replacing(path.with_suffix(".json")) as draft:
        draft.write_text(json.dumps(new), encoding="utf-8")
    with replacing(path) as draft:
        draft.write_text("".join(json.dumps(event) + "\n" for event in events), encoding="utf-8")


def _unused(folder: Path, name: str) -> Path:
    """Where a journal may be written: what was deleted once is another run when it comes back."""
    return next(path for i in itertools.count() if not (path := folder / f"{name}-{i}.jsonl").exists())


def _is_deleted(path: Path, root: Path) -> bool:
    """Whether a journal ends with its deletion."""
    if (journal := Journal.claim(path, root, PATIENCE_SECONDS)) is None:
        return False
    try:
        return journal.last().get("kind") == "delete"
    finally:
        journal.release()


def _delete(path: Path, root: Path) -> None:
    """Have the store delete the run of a journal; where no store has it, remove the journal."""
    journal = Journal.claim(path, root, PATIENCE_SECONDS)
    if journal is None:
        log.warning("tracking: %s belongs to another process: the run of an earlier summary stays", path)
        return
    try:
        if journal.state.run_id is None:
            path.unlink()
            path.with_suffix(".json").unlink(missing_ok=True)
        else:
            journal.append(new_event("delete"))
    finally:
        journal.release()
