"""The statistics of seeds against known answers: SciPy's, hand-computed ones, and all resamples gone through."""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import mannwhitneyu, trim_mean

from freemesh_ray.statistics.bootstrap import stratified_interval
from freemesh_ray.statistics.curves import (
    aligned,
    final_value,
    mean_and_deviation,
    mean_over_training,
    steps_to,
)
from freemesh_ray.statistics.improvement import (
    Verdict,
    improvement_interval,
    p_value,
    probability_of_improvement,
    verdict,
)
from freemesh_ray.statistics.interquartile import interquartile_mean, interquartile_mean_of_runs, weights
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


@pytest.mark.parametrize("statistic", [share, interquartile_mean_of_runs])
def test_the_interval_is_the_quantiles_of_all_resamples(statistic):
    scores = np.array([[0.3], [1.9], [5.0]])
    every = np.sort([statistic(np.array(drawn)[:, None]) for drawn in product(scores[:, 0], repeat=3)])
    found = stratified_interval(scores, statistic, resamples=100_000, level=0.8)
    assert found.value == statistic(scores)
    # The tenth of 27 equally likely resamples ends within the third, from either side.
    assert found.low == pytest.approx(every[2])
    assert found.high == pytest.approx(every[-3])


def test_strata_are_drawn_each_on_its_own():
    """Two strata far apart: a resample never mixes them, so that the mean stays within what the runs' spread allows."""
    scores = np.array([[0.0, 100.0], [1.0, 101.0]])
    found = stratified_interval(scores, share)
    assert (found.low, found.value, found.high) == (50.0, 50.5, 51.0)


def test_about_95_percent_of_the_intervals_cover_the_mean():
    random = np.random.default_rng(7)
    intervals = [
        stratified_interval(random.normal(3.0, 2.0, size=(40, 1)), share, resamples=500, seed=i) for i in range(400)
    ]
    covered = np.mean([found.low <= 3.0 <= found.high for found in intervals])
    assert 0.91 <= covered <= 0.97  # percentile intervals of 40 cover a little less than 95 %


@given(matrices(runs=(2, 6)), st.permutations(range(6)))
def test_an_interval_repeats_and_moves_and_scales_with_its_scores(scores: np.ndarray, order):
    found = stratified_interval(scores, interquartile_mean_of_runs, resamples=50)
    again = stratified_interval(scores, interquartile_mean_of_runs, resamples=50)
    assert found == again
    assert found.low <= found.high
    moved = stratified_interval(2 * scores + 5, interquartile_mean_of_runs, resamples=50)
    np.testing.assert_allclose(moved, 2 * np.array(found) + 5, atol=1e-6)
    shuffled = scores[[i for i in order if i < len(scores)]]
    np.testing.assert_allclose(interquartile_mean_of_runs(shuffled), found.value)


def test_leading_axes_share_the_draws():
    """A curve is one run: what is resampled is seeds, the same at every step."""
    scores = np.random.default_rng(0).normal(size=(4, 1))
    curves = np.stack([scores, scores + 10.0, 3.0 * scores])
    found = stratified_interval(curves, interquartile_mean_of_runs)
    np.testing.assert_allclose(found.low, [found.low[0], found.low[0] + 10.0, 3.0 * found.low[0]])


def test_memory_at_a_time_changes_nothing(monkeypatch):
    scores = np.random.default_rng(0).normal(size=(5, 3))
    at_once = stratified_interval(scores, share, resamples=100)
    monkeypatch.setattr("freemesh_ray.statistics.bootstrap.AT_A_TIME", 40)
    assert stratified_interval(scores, share, resamples=100) == at_once


@pytest.mark.parametrize("m", [1, 5])
def test_of_one_run_the_interval_is_the_point(m: int):
    found = stratified_interval(np.arange(m, dtype=float)[None], share)
    assert found.low == found.value == found.high


@pytest.mark.parametrize("scores", [np.empty((0, 2)), np.empty((2, 0)), np.ones(3), np.array([[1.0], [np.nan]])])
def test_no_interval_of_nothing(scores: np.ndarray):
    with pytest.raises(ValueError, match="scores"):
        stratified_interval(scores, share)


# ---- profiles --------------------------------------------------------------------------------------------------------


@given(matrices(), st.integers(0, 9))
def test_a_profile_falls_from_one_to_zero_inside_its_band(scores: np.ndarray, seed: int):
    thresholds = np.linspace(scores.min() - 1, scores.max() + 1, 17)
    found = performance_profile(scores, thresholds, resamples=60, seed=seed)
    assert (found.value[0], found.value[-1]) == (1.0, 0.0)
    for line in found:
        assert ((line >= 0) & (line <= 1)).all()
        assert (np.diff(line) <= 1e-12).all()
    assert (found.low <= found.high).all()


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


def test_its_interval_is_the_quantiles_of_all_resamples():
    x, y = np.array([1.0, 4.0]), np.array([0.0, 3.0])
    every = np.sort([
        probability_of_improvement(np.array(a)[:, None], np.array(b)[:, None])
        for a in product(x, repeat=2) for b in product(y, repeat=2)
    ])  # fmt: skip
    found = improvement_interval(x[:, None], y[:, None], resamples=50_000, level=0.8)
    assert found.value == 0.75
    assert found.low == pytest.approx(every[1])  # a tenth of 16 lies within the second
    assert found.high == pytest.approx(every[-2])


def test_strata_of_both_must_be_the_same():
    with pytest.raises(ValueError, match="2 and 3 strata"):
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


def test_verdicts():
    low, high, mixed = np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]), np.array([0.0, 2.5, 9.0])
    assert verdict(high, low) is Verdict.CONFIRMED
    assert verdict(low, high) is Verdict.REFUTED
    assert verdict(mixed, low) is verdict(low, mixed) is Verdict.UNDECIDED
    assert verdict(low, low) is Verdict.UNDECIDED
    assert verdict(high[:2], low) is Verdict.UNDECIDED  # one order in ten is as clear
    assert verdict(high[:1], low[:1]) is Verdict.UNDECIDED


@given(samples, samples)
def test_a_verdict_turns_with_its_sides(x: np.ndarray, y: np.ndarray):
    assume(len(x) * len(y) <= 36)
    turned = {
        Verdict.CONFIRMED: Verdict.REFUTED, Verdict.REFUTED: Verdict.CONFIRMED, Verdict.UNDECIDED: Verdict.UNDECIDED,
    }  # fmt: skip
    assert verdict(-x, -y) is turned[verdict(x, y)]


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


def test_single_figures_of_a_curve():
    assert final_value([1, 2, 3, 4, 5, 6, 7]) == 5.0
    assert final_value([1, 3]) == 2.0
    assert np.isnan(final_value([]))
    assert mean_over_training([0, 10, 40], [0, 2, 2]) == pytest.approx((10 + 60) / 40)
    assert mean_over_training([5], [3]) == 3.0
    assert mean_and_deviation([1, 3]) == (2.0, pytest.approx(np.sqrt(2)))
    mean, deviation = mean_and_deviation([4])
    assert mean == 4
    assert np.isnan(deviation)
