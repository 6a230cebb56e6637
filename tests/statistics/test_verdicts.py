"""Verdicts, equivalence, and the seeds that an open question needs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import mannwhitneyu, ttest_ind

from freemesh_ray.statistics.equivalence import difference
from freemesh_ray.statistics.permutation import p_value
from freemesh_ray.statistics.power import MOST, seeds_to_equate, seeds_to_separate
from freemesh_ray.statistics.verdict import Verdict, equality_verdict, order_verdict, separated

LOW, HIGH, MIXED = np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]), np.array([0.0, 2.5, 9.0])


def of_one(x: np.ndarray, y: np.ndarray) -> Verdict:
    """The verdict when nothing else was expected."""
    return order_verdict(x, y, p_value(x, y), p_value(y, x))


def test_orders():
    assert of_one(HIGH, LOW) is Verdict.CONFIRMED
    assert of_one(LOW, HIGH) is Verdict.REFUTED
    assert of_one(MIXED, LOW) is of_one(LOW, MIXED) is of_one(LOW, LOW) is Verdict.UNDECIDED


def test_runs_that_are_apart_are_confirmed_only_below_the_corrected_level():
    assert order_verdict(HIGH, LOW, 0.051, 1.0) is Verdict.SEPARATED
    assert order_verdict(LOW, HIGH, 1.0, 0.051) is Verdict.OPPOSED
    assert of_one(HIGH[:2], LOW) is Verdict.SEPARATED  # one order in ten is as clear
    assert of_one(HIGH[:1], LOW) is of_one(HIGH[:1], LOW[:1]) is Verdict.UNDECIDED
    assert not separated(np.array([3.0, 4.0]), LOW)  # a tie is not better


@given(st.lists(st.integers(0, 9), min_size=1, max_size=5), st.lists(st.integers(0, 9), min_size=1, max_size=5))
def test_a_verdict_turns_with_its_sides(x: list[int], y: list[int]):
    turned = {
        Verdict.CONFIRMED: Verdict.REFUTED, Verdict.REFUTED: Verdict.CONFIRMED, Verdict.UNDECIDED: Verdict.UNDECIDED,
        Verdict.SEPARATED: Verdict.OPPOSED, Verdict.OPPOSED: Verdict.SEPARATED,
    }  # fmt: skip
    assert of_one(-np.array(x), -np.array(y)) is turned[of_one(np.array(x), np.array(y))]


def test_equalities():
    assert equality_verdict(LOW, LOW, 1.0, same=True) is Verdict.SAME
    assert equality_verdict(LOW, LOW, 1.0, same=False) is Verdict.UNDECIDED
    assert equality_verdict(LOW, HIGH, 0.1, same=False) is Verdict.OPPOSED
    assert equality_verdict(LOW, HIGH, 0.04, same=False) is Verdict.REFUTED


def test_a_difference_is_welchs():
    x, y = np.array([9.0, 11.0, 10.5, 9.5]), np.array([10.0, 14.0, 9.0, 13.0, 11.0])
    found = difference(x, y)
    expected = ttest_ind(x, y, equal_var=False).confidence_interval(0.95)
    np.testing.assert_allclose(found.interval[1:], expected)
    assert found.interval.value == x.mean() - y.mean()
    assert found.margin == pytest.approx(0.1 * y.mean())
    np.testing.assert_allclose(found.shares, np.array(found.interval) / y.mean())


def test_the_same_means_zero_inside_and_all_within_a_tenth():
    near = np.array([99.0, 100.0, 101.0, 100.0])
    assert difference(near, near[::-1]).same
    assert difference(-near, -near).same  # a tenth of the magnitude
    assert not difference(near + 5.0, near).same  # within a tenth, but different
    assert not difference(10.0 * near - 900.0, near).same  # zero inside, but too wide
    assert not difference(near[:1], near).same  # one run: no interval
    assert not difference(near - 100.0, near - 100.0).same  # of nothing a tenth is nothing
    assert difference(np.full(3, 2.0), np.full(3, 2.0)).same


# ---- seeds that would be needed --------------------------------------------------------------------------------------


@pytest.mark.parametrize("apart", [0.7, 1.2, 3.0])
def test_the_seeds_that_are_said_separate_four_times_in_five(apart: float):
    x, y = np.array([-1.0, 1.0]) / np.sqrt(2) + apart, np.array([-1.0, 1.0]) / np.sqrt(2)  # deviations of 1
    n = seeds_to_separate(x, y, 0.05)
    assert n is not None
    random = np.random.default_rng(99)
    ahead, behind = random.normal(apart, 1.0, size=(2000, n)), random.normal(size=(2000, n))
    assert np.mean(mannwhitneyu(ahead, behind, axis=1, alternative="greater").pvalue <= 0.05) >= 0.76
    fewer = mannwhitneyu(ahead[:, 1:], behind[:, 1:], axis=1, alternative="greater").pvalue
    assert np.mean(fewer <= 0.05) <= 0.84


def test_seeds_that_separate_are_as_many_as_the_level_asks_for():
    apart = [np.array([100.0, 101.0, 102.0]), np.array([0.0, 1.0, 2.0])]
    assert seeds_to_separate(*apart, 0.05) == 3  # one order in 20
    assert seeds_to_separate(*apart, 0.05 / 13) == 6  # in 924; five: in 252
    assert seeds_to_separate(*apart[::-1], 0.05) == 3
    assert seeds_to_separate(LOW, LOW, 0.05) is None
    assert seeds_to_separate(LOW + 0.01, LOW, 0.05) is None


def test_the_seeds_that_are_said_show_equal_means_to_be_the_same_four_times_in_five():
    x = y = np.array([90.0, 100.0, 110.0])
    n = seeds_to_equate(x, y, 10.0)
    assert n is not None
    random = np.random.default_rng(5)
    found = [difference(*random.normal(100.0, 10.0, size=(2, n))).same for _ in range(1000)]
    assert 0.72 <= np.mean(found) <= 0.9  # the margin is that of the scores drawn
    assert seeds_to_equate(x, y, 5.0) > n
    assert seeds_to_equate(x, y, 0.1) is None
    assert seeds_to_equate(x, y, 1e9) == 2
    assert n < MOST
