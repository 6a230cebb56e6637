"""Records as one table: a row an evaluation of a training, then a row a domain that its best policy was measured on.

What is not of single evaluations is JSON in the table's metadata: the trainings, in the order of their rows, with how
many rows of either kind each has; settings that all trainings share stand there once.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import pyarrow as pa

from envs.mesh import Mesh
from freemesh_ray.records.measured import Measured, checked_mesh
from freemesh_ray.records.schema import COLUMNS, FIGURES, FORMAT, MESH, METADATA
from freemesh_ray.records.study_records import StudyRecords, Training
from freemesh_ray.storage.json_file import parsed

#: Arrow's types by their names in `COLUMNS`.
TYPES = {
    "string": pa.string(), "int64": pa.int64(), "double": pa.float64(), "bool": pa.bool_(),
    "list<float>": pa.list_(pa.float32()), "list<int32>": pa.list_(pa.int32()),
}  # fmt: skip
#: Whole numbers of a column lie within.
LARGEST = 2**63 - 1
#: Fields of the records themselves that the metadata holds as they are.
TEXTS = ("name", "study", "paper_table", "version", "machine", "date")
MAPPINGS = ("domains", "skipped", "source")

Row = dict[str, Any]


def to_table(records: StudyRecords) -> pa.Table:
    """The table; the same for the same records."""
    rows = [row for training in records.trainings for row in _rows(training)]
    figures = sorted({key for row in rows for key in row if key.startswith(FIGURES)})
    names = [*(name for name in COLUMNS if name not in MESH), *figures, *MESH]
    fields = [pa.field(name, TYPES[COLUMNS[name].type if name in COLUMNS else "double"]) for name in names]
    columns = [pa.array([row.get(each.name) for row in rows], each.type) for each in fields]
    schema = pa.schema(fields, {METADATA: _metadata(records).encode()})
    return pa.Table.from_arrays(columns, schema=schema)


def _rows(training: Training) -> Iterable[Row]:
    which = {"variant": _text(training.label), "seed": training.seed, "training": _text(training.run)}
    for row in training.evaluations:
        if _whole(row["env_steps"]):
            own = {_text(key): float(value) for key, value in row.items() if _is_figure(key, value)}
            seconds = {"seconds": float(row["seconds"])} if _is_number(row.get("seconds")) else {}
            yield {**which, "env_steps": int(row["env_steps"]), **seconds, **own}
    if training.measured is not None:
        for domain, figures in training.measured.figures.items():
            mesh = training.measured.meshes.get(domain)
            yield {**which, "domain": _text(domain), **figures, **(_mesh(mesh) if mesh is not None else {})}


def _mesh(mesh: Mesh) -> Row:
    values = (mesh.vertices.ravel(), mesh.quads.ravel(), mesh.segments.ravel(), bool(mesh.complete))
    return dict(zip(MESH, values, strict=True))


def _metadata(records: StudyRecords) -> str:
    plain = [{_text(str(key)): value for key, value in each.settings.items()} for each in records.trainings]
    common = _common(plain)
    told = {
        "format": FORMAT,
        **{name: _text(getattr(records, name)) for name in TEXTS},
        **{name: {_text(key): _text(value) for key, value in getattr(records, name).items()} for name in MAPPINGS},
        "episodes": records.episodes,
        "settings": common,
        "trainings": [_entry(training, own, common) for training, own in zip(records.trainings, plain, strict=True)],
    }
    return json.dumps(told, default=str, separators=(",", ":"))


def _common(settings: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Settings that all have, with one value; None of them where one is another's kind of the same number."""
    first = settings[0] if settings else {}
    return {
        key: value
        for key, value in first.items()
        if all(key in each and repr(each[key]) == repr(value) for each in settings)
    }


def _entry(training: Training, settings: Mapping[str, Any], common: Mapping[str, Any]) -> Row:
    evaluations = sum(_whole(row["env_steps"]) for row in training.evaluations)
    entry: Row = {
        "variant": _text(training.label), "seed": training.seed, "training": _text(training.run),
        "status": training.status, "error": _text(training.error), "drawn": dict(training.drawn),
        "settings": {key: value for key, value in settings.items() if key not in common},
        "updates": training.updates, "evaluations": evaluations,
    }  # fmt: skip
    if training.measured is not None:
        measured = training.measured
        digests = {_text(key): value for key, value in measured.digests.items()}
        entry["policy"] = {"commit": _text(measured.commit), "episodes": measured.episodes, "digests": digests,
                           "domains": len(measured.figures)}  # fmt: skip
    return entry


def _whole(value: Any) -> bool:
    return _is_number(value) and math.isfinite(value) and value == int(value) and 0 <= value <= LARGEST


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and (isinstance(value, float) or abs(value) <= LARGEST)


def _is_figure(key: Any, value: Any) -> bool:
    return isinstance(key, str) and key.startswith(FIGURES) and _is_number(value)


def _text(text: str) -> str:
    """A text without halves of letters, which no file can hold."""
    return text.encode("utf-8", "replace").decode()


def from_table(table: pa.Table) -> StudyRecords:
    """The records of a table.

    Raises:
        ValueError, KeyError, TypeError, AttributeError: it holds none, or not all of them.
    """
    told = parsed((table.schema.metadata or {})[METADATA].decode())
    if told["format"] != FORMAT:
        raise ValueError(f"its format is {told['format']!r:.20}, this release reads {FORMAT}")
    columns = {name: table.column(name).to_pylist() for name in table.column_names}
    for name, column in COLUMNS.items():
        if table.schema.field(name).type != TYPES[column.type]:
            raise ValueError(f"{name} is no {column.type}")
    figures = [name for name in columns if name.startswith(FIGURES)]
    if any(table.schema.field(name).type != TYPES["double"] for name in figures):
        raise ValueError("a figure is no double")
    trainings, at = [], 0
    for entry in told["trainings"]:
        training, at = _training(entry, told["settings"], columns, figures, at)
        trainings.append(training)
    if at != table.num_rows:
        raise ValueError("it has rows of no training")
    texts: dict[str, Any] = {name: _is(told[name], str) for name in TEXTS}
    mappings: dict[str, Any] = {
        name: {_is(key, str): _is(value, str) for key, value in _is(told[name], dict).items()} for name in MAPPINGS
    }
    return StudyRecords(trainings=trainings, episodes=_is(told["episodes"], int), **texts, **mappings)


def _training(
    entry: Mapping[str, Any], common: Any, columns: Mapping[str, list[Any]], figures: Sequence[str], at: int
) -> tuple[Training, int]:
    """The training of an entry, whose rows begin ``at`` a place, and where they end."""
    evaluations, policy = _is(entry["evaluations"], int), entry.get("policy")
    middle = at + evaluations
    end = middle + (_is(policy["domains"], int) if policy is not None else 0)
    if not at <= middle <= end <= len(columns["variant"]):
        raise ValueError("a training has more rows than there are")
    which = (_is(entry["variant"], str), _is(entry["seed"], int), _is(entry["training"], str))
    for i in range(at, end):
        if (columns["variant"][i], columns["seed"][i], columns["training"][i]) != which:
            raise ValueError("a row is of another training")
        if (columns["domain"][i] is None) != (i < middle) or (columns["env_steps"][i] is None) == (i < middle):
            raise ValueError("a row is no evaluation and of no domain")

    def figures_of(i: int) -> dict[str, float]:
        return {name: columns[name][i] for name in figures if columns[name][i] is not None}

    rows = []
    for i in range(at, middle):
        seconds = columns["seconds"][i]
        rows.append({"env_steps": columns["env_steps"][i], **({} if seconds is None else {"seconds": seconds}),
                     **figures_of(i)})  # fmt: skip
    measured = None
    if policy is not None:
        names = [columns["domain"][i] for i in range(middle, end)]
        meshes = {
            name: checked_mesh(name, *(columns[column][i] for column in MESH))
            for name, i in zip(names, range(middle, end), strict=True)
            if columns["vertices"][i] is not None
        }
        found = {name: figures_of(i) for name, i in zip(names, range(middle, end), strict=True)}
        measured = Measured(
            _is(policy["episodes"], int), found, _is(policy["digests"], dict), meshes, _is(policy["commit"], str)
        )
    updates = entry["updates"]
    training = Training(
        *which, _is(entry["status"], str), _is(entry["error"], str), _is(entry["drawn"], dict),
        {**_is(common, dict), **_is(entry["settings"], dict)}, rows, None if updates is None else _is(updates, int),
        measured,
    )  # fmt: skip
    return training, end


def _is(value: Any, kind: type) -> Any:
    """The value, which must be of a kind.

    Raises:
        ValueError: it is not.
    """
    if not isinstance(value, kind) or isinstance(value, bool):
        raise ValueError(f"{str(value)[:40]!r} is no {kind.__name__}")
    return value
