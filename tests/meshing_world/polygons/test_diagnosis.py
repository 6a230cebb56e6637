"""Everything that is wrong with rings is found, each once, with its place; and nothing in what is sound."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.domains.load import catalogue, load, rings_of
from envs.polygons.diagnosis import problems, readable

SQUARE = [[0, 0], [4, 0], [4, 2], [0, 2]]


def kinds(*polygons: list) -> Counter[str]:
    return Counter(problem.kind for problem in problems(readable(polygons)))


@pytest.mark.parametrize("name", catalogue())
def test_nothing_is_wrong_with_the_catalogue(name: str) -> None:
    assert problems(readable([rings_of(load(name))])) == []


def test_each_kind_is_found() -> None:
    assert kinds([[[0, 0], [2, 2], [2, 0], [0, 2]]]) == {"crossing": 1}
    assert kinds([[[0, 0], [4, 0], [4, 0], [4, 2], [0, 2]]]) == {"repeated point": 1}
    assert kinds([[[0, 0], [4, 0], [4, 1], [9, 1.05], [4, 1.1], [4, 2], [0, 2]]]) == {"spike": 1}
    assert kinds([SQUARE, [[3, 1], [5, 1], [5, 1.5], [3, 1.5]]]) == {"crossing": 2}  # a hole that leads outside
    assert kinds([SQUARE], [[[3, 0], [8, 0], [8, 2], [3, 2]]]) == {"overlap": 1}
    assert kinds([SQUARE], [[[4.001, 0], [8, 0], [8, 2], [4.001, 2]]]) == {"gap": 1}
    assert kinds([SQUARE], [[[4, 0], [8, 0], [8, 2], [4, 2]]]) == {}
    assert kinds([[[0, 0], [4, 0], [2, 1], [4, 2], [0, 2], [2, 1]]]) == {"crossing": 1}  # a pinch


def test_all_of_several_are_found_with_their_places() -> None:
    found = problems(readable([[[[0, 0], [4, 0], [4, 3], [2, -1], [2, -1], [0, 3], [0, 0]]]]))
    assert {(problem.kind, problem.place) for problem in found} == {
        ("repeated point", "(2, -1)"), ("crossing", "(1.5, 0)"), ("crossing", "(2.5, 0)"),
    }  # fmt: skip
    assert all(problem.fix and problem.told for problem in found)


@given(st.lists(st.tuples(st.integers(-4, 4), st.integers(-4, 4)), min_size=0, max_size=9))
def test_no_ring_is_too_bad(ring: list[tuple[int, int]]) -> None:
    for problem in problems(readable([[ring]])):
        assert np.isfinite([problem.x, problem.y]).all()


def test_what_are_no_rings_is_passed_over() -> None:
    assert readable([[SQUARE, "x", [[0, None]], [[0, float("nan")]], []]])[0][0].shape == (4, 2)
    assert problems(readable([[]])) == []
