"""Records in a Parquet file, Zstandard inside: written to the same bytes every time, read whoever wrote it."""

from __future__ import annotations

import os
import subprocess
import sys
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from freemesh_ray.records.study_records import RecordsError, StudyRecords
from freemesh_ray.storage.atomic import replacing
from freemesh_ray.storage.regular_file import opened

if TYPE_CHECKING:
    import pyarrow as pa

#: Bytes of a file at most, columns and values of a table: a hundred times what a study of 40 trainings has.
MOST_BYTES, MOST_COLUMNS, MOST_VALUES = 50_000_000, 3000, 20_000_000
#: Seconds that the trial may take, on a machine however busy.
MOST_SECONDS = 300.0
#: The system's allocator: a limit of addresses holds for what is taken, not for what others set aside.
ENVIRONMENT = {"ARROW_DEFAULT_MEMORY_POOL": "system", "MALLOC_ARENA_MAX": "1", "OMP_NUM_THREADS": "1"}


def write(path: Path, records: StudyRecords) -> Path:
    """Write records.

    Raises:
        OutputError: the place cannot be written to.
    """
    content = packed(records)
    with replacing(path) as draft:
        draft.write_bytes(content)
    return path


def packed(records: StudyRecords) -> bytes:
    """The file's bytes."""
    import pyarrow.parquet as parquet

    from freemesh_ray.records.table import to_table

    table, file = to_table(records), BytesIO()
    metadata = table.schema.metadata
    bare = table.replace_schema_metadata(None)
    with parquet.ParquetWriter(
        file, bare.schema, compression="zstd", compression_level=15, store_schema=False, write_statistics=False
    ) as writer:
        writer.write_table(bare, row_group_size=max(1, bare.num_rows))
        writer.add_key_value_metadata(metadata)
    return file.getvalue()


def read(path: Path) -> StudyRecords:
    """The records in a file.

    Raises:
        RecordsError: there is no such file, it holds none, or they are damaged.
    """
    content = _content(path)
    if not content.startswith(b"PAR1"):
        raise RecordsError(f"{path}: is no records file: give the records.parquet that a report wrote")
    _try(path, content)
    try:
        return unpacked(content)
    except Exception as error:  # what Arrow and a crafted table raise is many things
        raise _damaged(path, str(error) or type(error).__name__) from error


def unpacked(content: bytes) -> StudyRecords:
    """The records of a file's bytes.

    Raises:
        Exception: they are none.
    """
    import pyarrow.parquet as parquet

    from freemesh_ray.records.table import from_table

    with parquet.ParquetFile(BytesIO(content)) as file:
        about = file.metadata
        if about.num_columns > MOST_COLUMNS or about.num_columns * about.num_rows > MOST_VALUES:
            raise ValueError(f"{about.num_columns:,} columns of {about.num_rows:,} rows")
        table: pa.Table = file.read(use_threads=False)
        return from_table(table.replace_schema_metadata(about.metadata))


def _content(path: Path) -> bytes:
    try:
        with opened(path) as file:
            content = file.read(MOST_BYTES + 1)
    except ValueError as error:
        raise RecordsError(f"{path}: is {error}: give the records.parquet that a report wrote") from error
    except OSError as error:
        raise RecordsError(f"{path}: cannot be read ({error.strerror}): check the path") from error
    if len(content) > MOST_BYTES:
        raise RecordsError(f"{path}: is no records file: it has more than {MOST_BYTES:,} bytes")
    return content


def _try(path: Path, content: bytes) -> None:
    """Read it in a process that may not take much first.

    Raises:
        RecordsError: that failed.
    """
    program = Path(__file__).with_name("trial_read.py")
    try:
        done = subprocess.run(
            [sys.executable, "-P", str(program)], input=content, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
            env={**os.environ, **ENVIRONMENT}, check=False, timeout=MOST_SECONDS,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise _damaged(path, "it takes too much memory or time") from None
    if done.returncode:
        lines = done.stderr.decode("utf-8", "replace").strip().splitlines()
        raise _damaged(path, lines[-1] if lines and done.returncode > 0 else "it takes too much memory or time")


def _damaged(path: Path, reason: str) -> RecordsError:
    brief = " ".join(reason.split())[:120]
    return RecordsError(f"{path}: holds no records of a study, or damaged ones ({brief}): take another copy")
