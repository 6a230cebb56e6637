"""Records of studies: the same bytes for the same contents, and what comes back is what was written."""

from __future__ import annotations

import math
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from envs.mesh import Mesh
from freemesh_ray.policies.evaluation import FIGURES, MODES, metric
from freemesh_ray.records import measured_file
from freemesh_ray.records.measured import Measured, as_recorded
from freemesh_ray.records.parquet_file import packed, read, unpacked, write
from freemesh_ray.records.schema import COLUMNS
from freemesh_ray.records.study_records import RecordsError, StudyRecords, Training

TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
NUMBERS = st.floats(allow_nan=False)
METRICS = st.sampled_from([metric(mode, name, domain) for mode in MODES for name in FIGURES for domain in (None, "T1")])


@st.composite
def meshes(draw: st.DrawFn, name: str) -> Mesh:
    points = draw(
        npst.arrays(np.float32, st.tuples(st.integers(3, 9), st.just(2)), elements=st.floats(-9, 9, width=32))
    )
    places = st.integers(0, len(points) - 1)
    quads, ends = (
        draw(npst.arrays(np.int64, st.tuples(st.integers(0, 4), st.just(width)), elements=places)) for width in (4, 2)
    )
    return Mesh(name, points.astype(np.float64), quads, ends, draw(st.booleans()))


@st.composite
def measured(draw: st.DrawFn) -> Measured:
    domains = draw(st.lists(TEXTS, max_size=3, unique=True))
    figures = {name: draw(st.dictionaries(METRICS, NUMBERS, max_size=3)) for name in domains}
    digests = {name: draw(TEXTS) for name in domains}
    cut = {name: draw(meshes(name)) for name in domains if draw(st.booleans())}
    return Measured(draw(st.integers(0, 99)), figures, digests, cut, draw(TEXTS))


VALUES = st.one_of(st.none(), st.booleans(), st.integers(-(2**70), 2**70), NUMBERS, TEXTS, st.lists(st.integers()))
EVALUATIONS = st.builds(
    lambda steps, seconds, figures: {"env_steps": steps, "seconds": seconds, **figures},
    st.integers(0, 2**62), NUMBERS, st.dictionaries(METRICS, NUMBERS, max_size=4),
)  # fmt: skip
TRAININGS = st.builds(
    Training, TEXTS, st.integers(-(2**63), 2**63 - 1), TEXTS, TEXTS, TEXTS, st.dictionaries(TEXTS, VALUES, max_size=3),
    st.dictionaries(TEXTS, VALUES, max_size=3), st.lists(EVALUATIONS, max_size=4), st.none() | st.integers(0, 2**62),
    st.none() | measured(),
)  # fmt: skip
NAMED = st.dictionaries(TEXTS, TEXTS, max_size=3)
RECORDS = st.builds(
    StudyRecords, TEXTS, TEXTS, st.lists(TRAININGS, max_size=4), st.integers(0, 99), NAMED, NAMED, TEXTS, NAMED, TEXTS,
    TEXTS, TEXTS,
)  # fmt: skip


def plain(records: StudyRecords) -> object:
    """With meshes as lists, which can be compared."""
    trainings = []
    for training in records.trainings:
        told = dict(vars(training))
        if training.measured is not None:
            cut = {name: [mesh.name, mesh.vertices.tolist(), mesh.quads.tolist(), mesh.segments.tolist(), mesh.complete]
                   for name, mesh in training.measured.meshes.items()}  # fmt: skip
            told["measured"] = {**vars(training.measured), "meshes": cut}
        trainings.append(told)
    return {**vars(records), "trainings": trainings}


@pytest.mark.slow
@given(RECORDS)
@settings(max_examples=60)
def test_what_was_written_comes_back(records: StudyRecords) -> None:
    content = packed(records)
    assert plain(unpacked(content)) == plain(records)
    assert packed(unpacked(content)) == content == packed(records)


@given(measured())
@settings(max_examples=30)
def test_what_a_run_folder_has_of_it_comes_back(tmp_path_factory: pytest.TempPathFactory, found: Measured) -> None:
    run = tmp_path_factory.mktemp("run")
    measured_file.write(run, found)
    back = measured_file.read(run)
    assert back is not None
    one, other = (StudyRecords("", "", [Training("", 0, "", "", measured=each)], 0) for each in (found, back))
    assert plain(one) == plain(other)


def long_study(trainings: int = 40, evaluations: int = 40, domains: int = 5) -> StudyRecords:
    """Figures that no packing makes smaller, and a mesh a domain of every tenth training."""
    random = np.random.default_rng(0)
    names = [metric(mode, name, stage) for mode in MODES for name in FIGURES for stage in (None, "T1")]
    square = np.stack(np.meshgrid(np.arange(16.0), np.arange(16.0)), axis=-1).reshape(-1, 2)
    corner = np.arange(240)[np.arange(240) % 16 < 15]
    quads = np.stack([corner, corner + 1, corner + 17, corner + 16], axis=1)
    mesh = as_recorded(Mesh("square", square + random.random(square.shape) / 9, quads, quads[:15, :2], True))
    found = []
    for i in range(trainings):
        rows = [
            {"env_steps": 5000 * j, "seconds": float(random.random())}
            | dict(zip(names, random.random(24).tolist(), strict=True))
            for j in range(evaluations)
        ]
        figures = {f"D{j}": {metric(mode, name): float(random.random()) for mode in MODES for name in FIGURES}
                   for j in range(domains)}  # fmt: skip
        digests = dict.fromkeys(figures, "0123456789ab")
        cut = {name: replace(mesh, name=name) for name in figures} if i % 10 == 0 else {}
        config = {f"section.key_{j}": j for j in range(100)} | {"seed": i}
        told = Measured(10, figures, digests, cut, "0" * 40)
        found.append(Training(f"V{i // 10}", i, f"trial-{i:012x}-200000", "finished", "", {}, config, rows, 9, told))
    return StudyRecords("long", "study: {}", found, 10, digests)


def test_forty_trainings_of_forty_evaluations_are_small() -> None:
    records = long_study()
    content = packed(records)
    assert len(content) < 500_000
    assert plain(unpacked(content)) == plain(records)


def test_the_columns_are_as_told_and_other_programs_read_them(tmp_path: Path) -> None:
    path = write(tmp_path / "records.parquet", long_study(4, 3, 2))
    table = parquet.read_table(path)
    for name, column in COLUMNS.items():
        assert str(table.schema.field(name).type).replace("element", "item") == str(
            pa.list_(pa.float32()) if column.type == "list<float>" else
            pa.list_(pa.int32()) if column.type == "list<int32>" else column.type
        )  # fmt: skip
    rows = table.to_pylist()
    assert [row["env_steps"] for row in rows if row["domain"] is None] == [0, 5000, 10000] * 4
    assert [row["domain"] for row in rows if row["domain"] is not None] == ["D0", "D1"] * 4
    assert all(
        parquet.ParquetFile(path).metadata.row_group(0).column(i).compression == "ZSTD"
        for i in range(table.num_columns)
    )


def test_what_is_no_figure_is_left_out() -> None:
    rows = [
        {"env_steps": 1, "seconds": "long", metric("deterministic", "score"): "good", "eval_mine": True},
        {"env_steps": 1e300, metric("deterministic", "score"): 1.0},
        {"env_steps": 2, metric("deterministic", "score"): math.nan, "other": 3.0, "eval_\ud800": 1.0},
    ]
    (back,) = unpacked(
        packed(StudyRecords("a", "", [Training("\ud800", 1, "r", "finished", evaluations=rows)], 1))
    ).trainings
    assert [row["env_steps"] for row in back.evaluations] == [1, 2]
    assert math.isnan(back.evaluations[1][metric("deterministic", "score")])
    assert back.label == "?"


def test_a_missing_file_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(RecordsError, match=r"nowhere: cannot be read \(No such file"):
        read(tmp_path / "nowhere")


def bomb() -> bytes:
    """A few kilobytes that stand for 1.2 GB: thirty rows of ten million zeros."""
    file = BytesIO()
    zeros = pa.array([np.zeros(10_000_000, dtype=np.float32)], pa.list_(pa.float32()))
    schema = pa.schema([pa.field("vertices", zeros.type)])
    with parquet.ParquetWriter(file, schema, compression="zstd") as writer:
        for _ in range(30):
            writer.write_table(pa.Table.from_arrays([zeros], schema=schema))
    return file.getvalue()


@pytest.mark.slow
def test_little_that_stands_for_much_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "records.parquet"
    path.write_bytes(bomb())
    assert path.stat().st_size < 100_000
    with pytest.raises(RecordsError, match=r"damaged ones \((malloc|.*memory)") as error:
        read(path)
    assert "\n" not in str(error.value)
