"""The two trees of a front: whatever is done to them, they are what a fresh build gives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.kernels import slot_tree
from envs.types import Floats

CAPACITY = 16

slot = st.integers(0, CAPACITY - 1)
number = st.integers(-5, 5).map(float)
extent = st.integers(0, 4).map(float)
rectangle = st.tuples(number, number, extent, extent).map(lambda r: (r[0], r[1], r[0] + r[2], r[1] + r[3]))
change = (
    st.tuples(st.just("key"), slot, number | st.just(np.inf))
    | st.tuples(st.just("box"), slot, rectangle)
    | st.tuples(st.just("clear"), slot, st.none())
)


def empty() -> tuple[Floats, Floats]:
    """Trees without a key or a box."""
    key, box = np.full(2 * CAPACITY, np.inf), np.zeros((2 * CAPACITY, 4))
    box[CAPACITY:] = [np.inf, np.inf, -np.inf, -np.inf]
    slot_tree.build(key, box)
    return key, box


def changed(changes: list) -> tuple[Floats, Floats]:
    """Trees after a sequence of changes."""
    key, box = empty()
    for what, where, value in changes:
        if what == "key":
            slot_tree.set_key(key, where, value)
        elif what == "box":
            slot_tree.set_box(box, where, *value)
        else:
            slot_tree.clear_box(box, where)
    return key, box


def walk(box: Floats, query: tuple[float, float, float, float]) -> list[int]:
    """The slots that a pruned walk reaches, as kernels do it."""
    found, node = [], 1
    while node:
        if not slot_tree.box_meets(box, node, *query):
            node = slot_tree.following(node)
        elif node < CAPACITY:
            node *= 2
        else:
            found.append(node - CAPACITY)
            node = slot_tree.following(node)
    return found


@pytest.mark.slow
@given(st.lists(change, max_size=60), st.integers(1, CAPACITY + 2))
def test_least_slots_are_those_of_a_sort(changes: list, wanted: int) -> None:
    key, _ = changed(changes)
    before, slots = key.copy(), np.full(wanted, -1, dtype=np.int64)
    count = slot_tree.least_slots(key, slots, np.empty(wanted))
    leaves = key[CAPACITY:]
    expected = [slot for slot in np.argsort(leaves, kind="stable") if np.isfinite(leaves[slot])][:wanted]
    assert slots[:count].tolist() == expected
    np.testing.assert_array_equal(key, before)


@given(st.lists(change, max_size=60))
def test_changes_add_up_to_a_fresh_build(changes: list) -> None:
    key, box = changed(changes)
    fresh_key, fresh_box = key.copy(), box.copy()
    fresh_key[1:CAPACITY], fresh_box[1:CAPACITY] = np.nan, np.nan
    slot_tree.build(fresh_key, fresh_box)
    np.testing.assert_array_equal(key, fresh_key)
    np.testing.assert_array_equal(box, fresh_box)
    assert slot_tree.least_slot(key) == np.argmin(key[CAPACITY:])
    assert key[1] == key[CAPACITY:].min()


@given(st.lists(change, max_size=60), rectangle)
def test_a_walk_finds_what_a_scan_finds(changes: list, query: tuple[float, float, float, float]) -> None:
    _, box = changed(changes)
    x0, y0, x1, y1 = query
    leaves = box[CAPACITY:]
    meets = (leaves[:, 0] <= x1) & (leaves[:, 2] >= x0) & (leaves[:, 1] <= y1) & (leaves[:, 3] >= y0)
    assert walk(box, query) == np.flatnonzero(meets).tolist()


@given(st.lists(change, max_size=40), number, number)
def test_distance_to_a_box_bounds_all_below_it(changes: list, x: float, y: float) -> None:
    _, box = changed(changes)
    low, high = box[CAPACITY:, :2], box[CAPACITY:, 2:]
    nearest = np.clip([x, y], low, np.maximum(low, high))
    expected = np.where(np.isinf(low[:, 0]), np.inf, ((nearest - [x, y]) ** 2).sum(axis=1))
    found = [slot_tree.box_distance2(box, node, x, y) for node in range(1, 2 * CAPACITY)]
    np.testing.assert_array_equal(found[CAPACITY - 1 :], expected)
    for node in range(1, CAPACITY):
        assert found[node - 1] <= min(found[2 * node - 1], found[2 * node])


def test_following_visits_each_node_once() -> None:
    visited, node = [], 1
    while node:
        visited.append(node)
        node = 2 * node if node < CAPACITY else slot_tree.following(node)
    assert sorted(visited) == list(range(1, 2 * CAPACITY))
    assert [slot_tree.following(k) for k in (5, 4, 7, 1)] == [3, 5, 0, 0]
