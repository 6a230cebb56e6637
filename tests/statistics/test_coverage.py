"""How often intervals of 95 % cover what they are of, simulated: 93 to 97 % with five seeds and with ten, 89 to 98 with
three."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from freemesh_ray.statistics.bootstrap import interquartile_interval, seed_interval
from freemesh_ray.statistics.equivalence import difference
from freemesh_ray.statistics.improvement import improvement_interval
from freemesh_ray.statistics.interquartile import interquartile_mean_of_runs
from freemesh_ray.statistics.profile import performance_profile, share

#: Studies that are simulated; a coverage is known to about .01.
STUDIES = 1000
#: How far the domains' scores lie apart, in deviations of a seed's score on one.
EASE = np.array([0.0, 0.3, 0.6, 1.0, 1.5])
SEEDS = pytest.mark.parametrize("n", [5, 10])
DOMAINS = pytest.mark.parametrize(("m", "common"), [(1, 0.0), (5, 0.3), (5, 0.7)])


def scores(random: np.random.Generator, studies: int, n: int, m: int, common: float) -> np.ndarray:
    """(studies, n, m): normal scores of deviation 1; what a seed has in ``common`` on all domains is a share."""
    of_seed, own = random.normal(size=(studies, n, 1)), random.normal(size=(studies, n, m))
    return np.sqrt(common) * of_seed + np.sqrt(1.0 - common) * own + EASE[:m]


@pytest.mark.parametrize("n", [3, 5, 10])
@DOMAINS
def test_interquartile_means(n: int, m: int, common: float):
    random = np.random.default_rng([n, m])
    truth = interquartile_mean_of_runs(scores(random, 1, 200_000, m, common))[0]
    found = interquartile_interval(scores(random, STUDIES, n, m, common), resamples=500)
    assert 0.93 <= np.mean((found.low <= truth) & (truth <= found.high)) <= 0.97


@SEEDS
@DOMAINS
def test_means(n: int, m: int, common: float):
    random, truth = np.random.default_rng([n, m]), EASE[:m].mean()
    found = seed_interval(scores(random, STUDIES, n, m, common), share, resamples=500)
    assert 0.93 <= np.mean((found.low <= truth) & (truth <= found.high)) <= 0.97


def test_percentiles_of_a_bootstrap_would_not():
    """What the intervals were: the test above finds it."""
    random = np.random.default_rng(0)
    drawn = random.integers(5, size=(500, 5))
    resampled = interquartile_mean_of_runs(scores(random, STUDIES, 5, 1, 0.0)[:, drawn])
    low, high = np.quantile(resampled, [0.025, 0.975], axis=1)
    assert np.mean((low <= 0.0) & (high >= 0.0)) < 0.91


@pytest.mark.parametrize(("n", "most"), [(3, 0.98), (5, 0.97), (10, 0.97)])
@pytest.mark.parametrize("spread", [1.0, 3.0])
def test_differences_of_means(n: int, most: float, spread: float):
    random = np.random.default_rng(n)
    x, y = random.normal(7.0, spread, size=(STUDIES, n)), random.normal(5.0, 1.0, size=(STUDIES, n))
    found = [difference(a, b).interval for a, b in zip(x, y, strict=True)]
    assert 0.93 <= np.mean([each.low <= 2.0 <= each.high for each in found]) <= most


@SEEDS
@pytest.mark.parametrize("ahead", [0.0, 0.5, 1.0, 2.0])
def test_probabilities_of_improvement_on_one_domain(n: int, ahead: float):
    found = improvements(n, 1, 0.0, ahead)
    assert 0.93 <= found <= 0.97


@pytest.mark.parametrize("ahead", [0.0, 0.5, 1.0, 2.0])
def test_probabilities_of_improvement_with_three_seeds(ahead: float):
    assert 0.88 <= improvements(3, 1, 0.0, ahead) <= 0.99


@SEEDS
@pytest.mark.parametrize("common", [0.3, 0.7])
@pytest.mark.parametrize("ahead", [0.0, 0.5, 1.0])
def test_probabilities_of_improvement_on_several(n: int, common: float, ahead: float):
    found = improvements(n, 5, common, ahead)
    assert 0.93 <= found <= 0.97


def improvements(n: int, m: int, common: float, ahead: float) -> float:
    """Coverage of the probability that ``ahead`` deviations are an improvement."""
    random, truth = np.random.default_rng([n, m]), norm.cdf(ahead / np.sqrt(2.0))
    x, y = scores(random, STUDIES, n, m, common) + ahead, scores(random, STUDIES, n, m, common)
    found = improvement_interval(x, y)
    return float(np.mean((found.low <= truth) & (truth <= found.high)))


@SEEDS
@DOMAINS
def test_profiles_on_the_average_over_the_scores(n: int, m: int, common: float):
    """A share of five is one of six values: at a single score no interval covers 95 % exactly."""
    random = np.random.default_rng(n)
    thresholds = np.linspace(-1.5, 1.5, 31) + EASE[:m].mean()
    truth = norm.sf(thresholds[:, None] - EASE[:m]).mean(axis=1)
    found = performance_profile(scores(random, STUDIES, n, m, common), thresholds)
    assert 0.93 <= np.mean((found.low <= truth) & (truth <= found.high)) <= 0.97
