"""The statistics of seeds against known answers: SciPy's, hand-computed ones, and all resamples gone through."""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import binomtest, mannwhitneyu, sem, trim_mean
from scipy.stats import t as student

from freemesh_ray.statistics.aligned_curves import (
    aligned,
    final_value,
    mean_and_deviation,
    mean_over_training,
    steps_to,
)
from freemesh_ray.statistics.bootstrap import interquartile_interval, seed_interval
from freemesh_ray.statistics.improvement import improvement_interval, newcombe_variance, probability_of_improvement
from freemesh_ray.statistics.interquartile import interquartile_mean, interquartile_mean_of_runs, weights
from freemesh_ray.statistics.permutation import holm, p_value, two_sided
from freemesh_ray.statistics.profile import performance_profile, share

finite = st.floats(-1e3, 1e3)
samples = st.lists(finite, min_size=1, max_size=12).map(np.array)


def matrices(runs: tuple[int, int] = (1, 6), strata: tuple[int, int] = (1, 4)) -> st.SearchStrategy[np.ndarray]:
    """(n, m) scores."""
    shape = st.tuples(st.integers(*runs), st.integers(*strata))
    return shape.flatmap(lambda shape: arrays(np.float64, shape, elements=finite))


# ---- interquartile mean ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [4, 8, 12, 40])
def test_where_4_divides_n_it_is_the_trimmed_mean(n: int):
    values = np.random.default_rng(n).normal(size=(5, n))
    np.testing.assert_allclose(interquartile_mean(values), trim_mean(values, 0.25, axis=1))


@pytest.mark.parametrize(
    ("n", "expected"),
    [(1, [1]), (2, [1, 1]), (3, [1, 4, 1]), (5, [0, 3, 4, 3, 0]), (6, [0, 1, 2, 2, 1, 0]), (7, [0, 1, 4, 4, 4, 1, 0])],
)
def test_elsewhere_the_outer_ones_of_the_middle_half_count_in_part(n: int, expected: list[int]):
    np.testing.assert_allclose(weights(n), np.array(expected) / np.sum(expected))


@given(samples, finite, st.floats(-10, 10))
def test_the_interquartile_mean_moves_and_scales_with_its_values(values: np.ndarray, shift: float, factor: float):
    found = interquartile_mean(values)
    assert values.min() - 1e-9 <= found <= values.max() + 1e-9
    assert interquartile_mean(values[::-1]) == found
    np.testing.assert_allclose(interquartile_mean(values + shift), found + shift, atol=1e-6)
    np.testing.assert_allclose(interquartile_mean(factor * values), factor * found, atol=1e-6)


def test_one_wild_run_does_not_move_it():
    assert interquartile_mean(np.array([1.0, 2.0, 3.0, 4.0])) == interquartile_mean(np.array([-1e9, 2.0, 3.0, 4.0]))


# ---- bootstrap -------------------------------------------------------------------------------------------------------


def test_of_a_mean_the_interval_is_students():
    scores = np.array([3.0, 5.0, 4.0, 9.0, 6.0])
    found = seed_interval(scores[:, None], share, resamples=200_000)
    expected = student.interval(0.95, 4, scores.mean(), sem(scores))
    np.testing.assert_allclose([found.low, found.high], expected, rtol=0.01)


def test_the_standard_error_is_that_of_all_resamples():
    scores = np.array([[0.3], [1.9], [5.0]])
    every = [interquartile_mean_of_runs(np.array(drawn)[:, None]) for drawn in product(scores[:, 0], repeat=3)]
    half = student.ppf(0.9, 2) * np.std(every) * np.sqrt(3 / 2)
    found = seed_interval(scores, interquartile_mean_of_runs, resamples=200_000, level=0.8)
    assert found.value == interquartile_mean_of_runs(scores)
    np.testing.assert_allclose([found.low, found.high], [found.value - half, found.value + half], rtol=0.01)


def test_on_one_domain_an_interquartile_mean_is_not_widened():
    scores = np.random.default_rng(0).normal(size=(5, 1))
    found, wide = interquartile_interval(scores), seed_interval(scores, interquartile_mean_of_runs)
    assert wide.high - wide.low == pytest.approx((found.high - found.low) * np.sqrt(5 / 4))
    twice = np.repeat(scores, 2, axis=1)
    assert interquartile_interval(twice) == seed_interval(twice, interquartile_mean_of_runs)


def test_a_seed_is_drawn_whole():
    """Seeds that are better on one domain by what they are worse on the other: their means are equal, and certain."""
    scores = np.array([[0.0, 10.0], [3.0, 7.0], [8.0, 2.0]])
    found = seed_interval(scores, share)
    assert found.low == pytest.approx(5.0)
    assert found.high == pytest.approx(5.0)
    together = seed_interval(np.array([[0.0, 0.0], [3.0, 3.0], [8.0, 8.0]]), share)
    alone = seed_interval(np.array([[0.0], [3.0], [8.0]]), share)
    np.testing.assert_allclose(together, alone)  # a second domain that says the same adds nothing


def test_an_interval_stays_within_its_bounds():
    scores = np.array([[0.9], [1.0], [0.2]])
    found = seed_interval(scores, share, bounds=(0.0, 1.0))
    free = seed_interval(scores, share)
    assert (found.low, found.high) == (0.0, 1.0)
    assert free.low < 0.0
    assert free.high > 1.0


@given(matrices(runs=(2, 6)), st.permutations(range(6)))
def test_an_interval_repeats_and_moves_and_scales_with_its_scores(scores: np.ndarray, order):
    found = seed_interval(scores, interquartile_mean_of_runs, resamples=50)
    again = seed_interval(scores, interquartile_mean_of_runs, resamples=50)
    assert found == again
    assert found.low <= found.value <= found.high
    moved = seed_interval(2 * scores + 5, interquartile_mean_of_runs, resamples=50)
    np.testing.assert_allclose(moved, 2 * np.array(found) + 5, atol=1e-6)
    shuffled = scores[[i for i in order if i < len(scores)]]
    np.testing.assert_allclose(interquartile_mean_of_runs(shuffled), found.value)


def test_leading_axes_share_the_draws():
    """A curve is one run: what is resampled is seeds, the same at every step."""
    scores = np.random.default_rng(0).normal(size=(4, 1))
    curves = np.stack([scores, scores + 10.0, 3.0 * scores])
    found = seed_interval(curves, interquartile_mean_of_runs)
    np.testing.assert_allclose(found.low, [found.low[0], found.low[0] + 10.0, 3.0 * found.low[0]])


def test_memory_at_a_time_changes_nothing(monkeypatch):
    scores = np.random.default_rng(0).normal(size=(5, 3))
    at_once = seed_interval(scores, share, resamples=100)
    monkeypatch.setattr("freemesh_ray.statistics.bootstrap.AT_A_TIME", 40)
    assert seed_interval(scores, share, resamples=100) == at_once


@pytest.mark.parametrize("m", [1, 5])
def test_of_one_run_the_interval_is_the_point(m: int):
    found = seed_interval(np.arange(m, dtype=float)[None], share)
    assert found.low == found.value == found.high


@pytest.mark.parametrize("scores", [np.empty((0, 2)), np.empty((2, 0)), np.ones(3), np.array([[1.0], [np.nan]])])
def test_no_interval_of_nothing(scores: np.ndarray):
    with pytest.raises(ValueError, match="scores"):
        seed_interval(scores, share)


# ---- profiles --------------------------------------------------------------------------------------------------------


@given(matrices())
def test_a_profile_falls_from_one_to_zero_inside_its_band(scores: np.ndarray):
    thresholds = np.linspace(scores.min() - 1, scores.max() + 1, 17)
    found = performance_profile(scores, thresholds)
    assert (found.value[0], found.value[-1]) == (1.0, 0.0)
    for line in found:
        assert ((line >= 0) & (line <= 1)).all()
        assert (np.diff(line) <= 1e-12).all()
    assert (found.low <= found.value).all()
    assert (found.value <= found.high).all()


def test_the_band_of_a_profile_on_one_domain_is_wilsons():
    scores = np.arange(10.0)[:, None]
    found = performance_profile(scores, np.array([-1.0, 2.0, 6.5]))
    for k, low, high in zip([10, 7, 3], found.low, found.high, strict=True):
        np.testing.assert_allclose([low, high], binomtest(k, 10).proportion_ci(method="wilson"), atol=1e-9)


def test_a_profile_by_hand():
    found = performance_profile(np.array([[0.2, 0.8], [0.4, 0.8]]), np.array([0.0, 0.2, 0.3, 0.8]))
    np.testing.assert_allclose(found.value, [1.0, 0.75, 0.75, 0.0])


# ---- probability of improvement --------------------------------------------------------------------------------------


@given(samples, samples)
def test_it_is_mann_whitneys_u_by_the_number_of_pairs(x: np.ndarray, y: np.ndarray):
    u = mannwhitneyu(x, y).statistic
    assert probability_of_improvement(x[:, None], y[:, None]) == pytest.approx(u / (len(x) * len(y)))


@given(matrices(runs=(1, 5), strata=(2, 2)), matrices(runs=(1, 5), strata=(2, 2)))
def test_both_sides_sum_to_one_and_a_rising_map_changes_nothing(x: np.ndarray, y: np.ndarray):
    found = probability_of_improvement(x, y)
    assert 0.0 <= found <= 1.0
    assert probability_of_improvement(y, x) == pytest.approx(1.0 - found)
    assert probability_of_improvement(x, x) == pytest.approx(0.5)
    assert probability_of_improvement(2.0 * x, 2.0 * y) == found
    assert probability_of_improvement(x[::-1], y) == pytest.approx(found)


def test_its_interval_by_hand():
    """Newcombe's method 5: both ends are as many deviations away as 95 % ask for; of a whole order none is an end."""
    x, y = np.array([1.0, 4.0, 5.0, 6.0]), np.array([0.0, 3.0, 2.0])
    found = improvement_interval(x[:, None], y[:, None])
    assert found.value == pytest.approx(10 / 12)
    for end in (found.low, found.high):
        others = 0.5 * (4 + 3) - 1
        variance = end * (1 - end) * (1 + others * (1 - end) / (2 - end) + others * end / (1 + end)) / 12
        assert abs(end - 10 / 12) == pytest.approx(1.959964 * np.sqrt(variance))
    whole = improvement_interval(x[:, None] + 10.0, y[:, None])
    assert whole.value == whole.high == 1.0
    assert 0.4 < whole.low < 0.8


def test_the_variance_of_equal_algorithms_is_mann_and_whitneys():
    assert newcombe_variance(np.array(0.5), 6, 6) == pytest.approx(13 / (12 * 36))


@given(matrices(runs=(2, 5), strata=(1, 4)), st.integers(0, 9))
def test_the_interval_turns_with_its_sides_and_more_of_the_same_domains_add_nothing(x: np.ndarray, seed: int):
    y = np.random.default_rng(seed).normal(0.0, 500.0, size=(3, x.shape[1]))
    found, turned = improvement_interval(x, y), improvement_interval(y, x)
    assert 0.0 <= found.low <= found.value <= found.high <= 1.0
    np.testing.assert_allclose([turned.low, turned.high], [1.0 - found.high, 1.0 - found.low], atol=1e-9)
    one = improvement_interval(x[:, :1], y[:, :1])
    copied = improvement_interval(np.repeat(x[:, :1], 4, axis=1), np.repeat(y[:, :1], 4, axis=1))
    assert copied.value == one.value
    assert copied.high - copied.low >= 0.8 * (one.high - one.low)


def test_domains_of_both_must_be_the_same():
    with pytest.raises(ValueError, match="2 and 3 domains"):
        improvement_interval(np.ones((2, 2)), np.ones((2, 3)))


@given(st.integers(1, 4), st.integers(1, 4), st.integers(0, 9))
def test_the_p_value_is_the_share_of_orders_that_are_as_clear(n: int, m: int, seed: int):
    values = np.round(np.random.default_rng(seed).normal(size=n + m), 1)
    x, y = values[:n], values[n:]
    observed = probability_of_improvement(x[:, None], y[:, None])
    orders = [
        probability_of_improvement(values[list(a)][:, None], np.delete(values, list(a))[:, None])
        for a in combinations(range(n + m), n)
    ]
    assert p_value(x, y) == pytest.approx(np.mean(np.array(orders) >= observed - 1e-12))


def test_of_many_runs_the_p_value_is_estimated_and_agrees_with_mann_and_whitney():
    random = np.random.default_rng(3)
    x, y = random.normal(0.7, 1, size=15), random.normal(size=14)
    expected = mannwhitneyu(x, y, alternative="greater", method="exact").pvalue
    assert p_value(x, y) == pytest.approx(expected, rel=0.2)
    assert p_value(x, y) == p_value(x, y)


@given(samples, samples)
def test_two_sided_is_twice_the_smaller_side(x: np.ndarray, y: np.ndarray):
    assume(len(x) * len(y) <= 36)
    assert two_sided(x, y) == two_sided(y, x) == min(1.0, 2.0 * min(p_value(x, y), p_value(y, x)))


def test_holm_by_hand():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.6]) == [1.0, 1.0]
    assert holm([0.04]) == [0.04]
    assert holm([]) == []


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8), st.floats(0.001, 0.2))
def test_holm_rejects_what_its_steps_reject(p: list[float], level: float):
    """The smallest at level / k, the next at level / (k - 1), until one is above."""
    order, rejected = sorted(range(len(p)), key=lambda i: p[i]), set()
    for step, i in enumerate(order):
        if p[i] * (len(p) - step) > level:
            break
        rejected.add(i)
    assert {i for i, corrected in enumerate(holm(p)) if corrected <= level} == rejected


# ---- curves ----------------------------------------------------------------------------------------------------------


def test_curves_are_interpolated_where_all_have_values_and_nowhere_beyond():
    steps, values = aligned([([0, 10, 20], [0, 1, 2]), ([15, 5, 25], [15, 5, 25]), ([], []), ([3], [np.nan])])
    assert steps.tolist() == [5, 10, 15, 20]
    np.testing.assert_allclose(values, [[0.5, 1.0, 1.5, 2.0], [5, 10, 15, 20]])


def test_curves_without_a_common_step():
    steps, values = aligned([([0, 1], [0, 1]), ([2, 3], [0, 1])])
    assert steps.shape == (0,)
    assert values.shape == (2, 0)
    assert aligned([])[0].shape == (0,)


def test_steps_to_a_value():
    steps, values = [10, 20, 30, 40], [0.0, 4.0, 2.0, 8.0]
    assert steps_to(steps, values, 2.0) == 15.0  # the first time
    assert steps_to(steps, values, 6.0) == pytest.approx(30 + 10 * 4 / 6)
    assert steps_to(steps, values, -1.0) == 10.0
    assert steps_to(steps, values, 8.0) == 40.0
    assert steps_to(steps, values, 8.1) is None
    assert steps_to([], [], 0.0) is None


@given(st.lists(finite, min_size=1, max_size=20), finite)
def test_a_higher_value_takes_no_fewer_steps(values: list[float], threshold: float):
    steps = np.arange(len(values))
    near, far = steps_to(steps, values, threshold), steps_to(steps, values, threshold + 1.0)
    assert far is None or (near is not None and near <= far)
    assert (near is None) == (max(values) < threshold)


def test_the_final_value_is_of_the_last_tenth_of_the_training():
    steps = np.arange(5_000, 100_001, 5_000)
    values = np.where(steps < 90_000, -1e6, steps)
    assert final_value(steps, values) == 95_000.0  # of 90, 95 and 100 thousand steps
    assert final_value([10, 20], [1, 3]) == 3.0
    assert final_value([0], [2]) == 2.0
    assert np.isnan(final_value([], []))


def test_single_figures_of_a_curve():
    assert mean_over_training([0, 10, 40], [0, 2, 2]) == pytest.approx((10 + 60) / 40)
    assert mean_over_training([5], [3]) == 3.0
    assert mean_and_deviation([1, 3]) == (2.0, pytest.approx(np.sqrt(2)))
    mean, deviation = mean_and_deviation([4])
    assert mean == 4
    assert np.isnan(deviation)
