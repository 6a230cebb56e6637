"""A run's journal: what was written to it whole is read whole, whatever a crash has made of its end."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from freemesh_ray.tracking.events import new_event
from freemesh_ray.tracking.journal import Journal, State


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes]:
    """A journal of four steps, and what it holds."""
    folder = tmp_path_factory.mktemp("run")
    journal = Journal.new(folder, State("sqlite:///store.db", "experiment"))
    for step in range(4):
        journal.append(new_event("metrics", step=step, values={"loss": 0.5 * step}))
    journal.release()
    return journal.path, journal.path.read_bytes()


@settings(max_examples=30)
@given(cut=st.integers(0, 200))
def test_a_line_cut_short_by_a_crash_takes_no_other_with_it(recorded: tuple[Path, bytes], cut: int) -> None:
    path, content = recorded
    left = content[: len(content) - cut]
    path.write_bytes(left)
    journal = Journal.claim(path, path.parents[1])
    assert journal is not None
    journal.append(new_event("metrics", step=9, values={"loss": 9.0}))
    steps = [event["step"] for event, _ in journal.read() if event]
    journal.release()
    # A line that lacks its end alone is whole, too.
    assert steps == [*range(left.count(b"\n") + left.endswith(b"}}")), 9]
