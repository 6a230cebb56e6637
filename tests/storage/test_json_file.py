"""JSON of any origin is read within bounds, or told in words."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from traced_memory import little_memory

from freemesh_ray.config import ConfigError, read_plain
from freemesh_ray.storage import json_file
from freemesh_ray.storage.json_file import read_json, read_text


@pytest.mark.parametrize(("content", "words"), [
    (b"", "Expecting value"),
    (b"[" * 100_000, "nested too deep"),
    (b"[" * 1_000_001, "more than 1,000,000 values"),
    (b"[" + b"0," * 1_000_000 + b"0]", "more than 1,000,000 values"),
    (b"9" * 5_000, "digits"),
    (b"\xff", "Expecting value"),
    (b" " * 20_000_001, "more than 20,000,000 bytes"),
])  # fmt: skip
def test_what_is_too_much_is_refused(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "file.json"
    path.write_bytes(content)
    with little_memory(90_000_000), pytest.raises(ValueError, match=words):
        read_json(path)


def test_a_sparse_file_of_a_terabyte_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "file.json"
    path.touch()
    os.truncate(path, 10**12)
    with little_memory(90_000_000), pytest.raises(ValueError, match="more than 20,000,000 bytes"):
        read_text(path)


def test_pipes_and_devices_are_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.yaml")
    signal.alarm(20)  # ends the test where it waits
    try:
        for path in (tmp_path / "pipe.yaml", Path("/dev/zero"), tmp_path):
            with pytest.raises((ValueError, OSError)):
                read_json(path)
        with pytest.raises(ConfigError, match="is empty"):
            read_plain(tmp_path / "pipe.yaml")
    finally:
        signal.alarm(0)


@pytest.mark.slow
def test_the_most_that_is_read_takes_bounded_memory(tmp_path: Path) -> None:
    path = tmp_path / "file.json"
    path.write_text("[" + "[]," * ((json_file.MOST_VALUES - 3) // 2) + "[]]")
    with little_memory(100_000_000):
        assert len(read_json(path)) > 400_000
