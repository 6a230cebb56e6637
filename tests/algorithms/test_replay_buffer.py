"""The replay buffer against a plain list."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from freemesh_ray.algorithms.replay_buffer import ReplayBuffer, Transitions, concatenate


def numbered(first: int, count: int) -> Transitions:
    """Transitions that carry their number in every field."""
    number = np.arange(first, first + count, dtype=np.float32)
    return Transitions(
        np.stack([number] * 3, axis=1),
        np.stack([number] * 2, axis=1),
        number,
        np.stack([number + 1] * 3, axis=1),
        number % 2,
        number % 5,
    )


def held(buffer: ReplayBuffer) -> list[float]:
    """The numbers of the transitions in it, sorted."""
    return sorted(buffer.get_state()["rows"][2].tolist())


@given(st.integers(1, 20), st.lists(st.integers(0, 30), max_size=12))
def test_it_holds_the_newest(capacity: int, sizes: list[int]) -> None:
    buffer, added = ReplayBuffer(capacity, 3, 2, seed=0), 0
    for size in sizes:
        buffer.add(numbered(added, size))
        added += size
    assert held(buffer) == list(range(max(0, added - capacity), added))
    assert len(buffer) == min(capacity, added)


@given(st.integers(1, 20), st.lists(st.integers(1, 30), min_size=1, max_size=6))
def test_samples_are_whole_rows_of_what_it_holds(capacity: int, sizes: list[int]) -> None:
    buffer, added = ReplayBuffer(capacity, 3, 2, seed=0), 0
    for size in sizes:
        buffer.add(numbered(added, size))
        added += size
    rows = buffer.sample(64)
    assert set(rows.rewards) <= set(held(buffer))
    assert (rows.obs == rows.rewards[:, None]).all()
    assert (rows.actions == rows.rewards[:, None]).all()
    assert (rows.next_obs == rows.rewards[:, None] + 1).all()
    assert (rows.terminated == rows.rewards % 2).all()


@given(st.integers(1, 20), st.lists(st.integers(1, 30), min_size=1, max_size=6), st.integers(1, 20))
def test_a_restored_buffer_goes_on_as_the_original(capacity: int, sizes: list[int], more: int) -> None:
    buffer, added = ReplayBuffer(capacity, 3, 2, seed=0), 0
    for size in sizes:
        buffer.add(numbered(added, size))
        added += size
    other = ReplayBuffer(capacity, 3, 2, seed=99)
    other.set_state(buffer.get_state())
    for one in (buffer, other):
        one.add(numbered(added, more))
    assert held(buffer) == held(other)
    np.testing.assert_array_equal(buffer.sample(32).rewards, other.sample(32).rewards)


@given(st.integers(1, 30), st.integers(1, 20), st.integers(1, 20))
def test_a_smaller_buffer_takes_over_the_newest(added: int, large: int, small: int) -> None:
    buffer = ReplayBuffer(large, 3, 2)
    for number in range(added):
        buffer.add(numbered(number, 1))
    other = ReplayBuffer(small, 3, 2)
    other.set_state(buffer.get_state())
    kept = min(added, large, small)
    assert held(other) == list(range(added - kept, added))


def test_a_checkpoint_on_disk_brings_it_back(tmp_path: Path) -> None:
    buffer = ReplayBuffer(100, 3, 2, seed=5)
    buffer.add(numbered(0, 70))
    buffer.save_to_path(tmp_path / "buffer")
    again = ReplayBuffer.from_checkpoint(tmp_path / "buffer")
    np.testing.assert_array_equal(buffer.sample(50).rewards, again.sample(50).rewards)


def test_sampling_is_uniform() -> None:
    buffer = ReplayBuffer(50, 3, 2, seed=1)
    buffer.add(numbered(0, 50))
    counts = np.bincount(buffer.sample(100_000).rewards.astype(int), minlength=50)
    # 2,000 expected each; a deviation of 5 sigma would be 221.
    assert np.abs(counts - 2000).max() < 221


def test_an_empty_buffer_says_so() -> None:
    with pytest.raises(ValueError, match="empty"):
        ReplayBuffer(10, 3, 2).sample(1)


def test_concatenate_keeps_the_order() -> None:
    assert concatenate([numbered(0, 2), numbered(2, 3)]).rewards.tolist() == [0, 1, 2, 3, 4]
