"""What is free is the machine's memory or the container's, whichever is less."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from freemesh_ray.storage import free_memory
from freemesh_ray.storage.free_memory import MemoryShortError, check


def test_free_memory_is_the_machines_or_the_containers(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert 1e7 < free_memory.of_machine() < 1e15
    monkeypatch.setattr(free_memory, "CONTAINER", tmp_path)
    assert free_memory.of_container() == math.inf
    for name, text in (
        ("max", "3000\n"),
        ("current", "2000\n"),
        ("stat", "anon 5\ninactive_file 700\nactive_file 9\n"),
    ):
        (tmp_path / f"memory.{name}").write_text(text)
    assert free_memory.available() == free_memory.of_container() == 1700
    (tmp_path / "memory.max").write_text("max\n")
    assert (free_memory.of_container(), free_memory.available() > 1700) == (math.inf, True)


def test_what_does_not_fit_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(free_memory, "available", lambda: 2e9)
    check(2e9, "part")
    with pytest.raises(MemoryShortError, match=r"^part: it takes 2\.1 GB of memory, 2 GB are free: use less$"):
        check(2.1e9, "part: it", "use less")
